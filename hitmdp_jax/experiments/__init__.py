"""Many trainings compared: arms, statistics, tables and published results."""
