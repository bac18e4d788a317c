"""What a trained policy does, and what its options are for."""

import hitmdp_jax.quiet_mjx  # noqa: F401
