"""Training runs: the pure program, and the host around it (loop, display, files)."""
