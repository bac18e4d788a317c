"""Pure pieces that agents share: rollout, advantages, surrogate, optimisation, option counts."""

import hitmdp_jax.quiet_mjx  # noqa: F401
