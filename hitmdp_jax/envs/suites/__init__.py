"""Suites of tasks, one file or folder each."""
