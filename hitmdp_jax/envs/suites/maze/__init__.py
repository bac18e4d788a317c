"""Mazes in which a robot must reach a goal that is elsewhere in every episode."""
