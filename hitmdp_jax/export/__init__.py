"""Policies as programs of their own."""
