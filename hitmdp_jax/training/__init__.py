"""Training runs: the pure program, and the host around it (loop, display, files)."""

import hitmdp_jax.quiet_mjx  # noqa: F401
