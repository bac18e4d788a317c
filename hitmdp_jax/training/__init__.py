"""One training as pure functions, and sweeps of many."""

import hitmdp_jax.quiet_mjx  # noqa: F401
