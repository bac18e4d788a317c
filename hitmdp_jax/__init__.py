"""Options as embedding vectors on Hidden Temporal MDPs, trained end to end in JAX."""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()):
    # MJX, which Brax imports, prints two lines where the optional Warp back end is missing.
    import mujoco.mjx  # noqa: F401

from hitmdp_jax import agents
from hitmdp_jax.envs import list_envs, make_env, register_env
from hitmdp_jax.envs.spec import Spec, spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.policy import Policy, load, save
from hitmdp_jax.training.program import TrainState, make_train, train

__all__ = [
    "Policy",
    "Spec",
    "TrainState",
    "UsageError",
    "agents",
    "list_envs",
    "load",
    "make_env",
    "make_train",
    "register_env",
    "save",
    "spec_of",
    "train",
]
