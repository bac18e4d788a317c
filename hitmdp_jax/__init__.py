"""Options as embedding vectors on Hidden Temporal MDPs, trained end to end in JAX."""

from typing import TYPE_CHECKING

from hitmdp_jax import lazy

if TYPE_CHECKING:
    from hitmdp_jax import agents
    from hitmdp_jax.envs import list_envs, make_env, register_env
    from hitmdp_jax.envs.spec import Spec, spec_of
    from hitmdp_jax.errors import UsageError
    from hitmdp_jax.runs.policy import load
    from hitmdp_jax.runs.saving import save
    from hitmdp_jax.training.callbacks import Callback
    from hitmdp_jax.training.policy import Policy
    from hitmdp_jax.training.program import make_train, train
    from hitmdp_jax.training.state import TrainState
    from hitmdp_jax.version import __version__

__all__ = [
    "Callback",
    "Policy",
    "Spec",
    "TrainState",
    "UsageError",
    "__version__",
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

__getattr__, __dir__ = lazy.attach(
    __name__,
    {
        "agents": "agents",
        "UsageError": "errors",
        "__version__": "version",
        **dict.fromkeys(("list_envs", "make_env", "register_env"), "envs"),
        **dict.fromkeys(("Spec", "spec_of"), "envs.spec"),
        "load": "runs.policy",
        "Callback": "training.callbacks",
        "Policy": "training.policy",
        "save": "runs.saving",
        **dict.fromkeys(("make_train", "train"), "training.program"),
        "TrainState": "training.state",
    },
)
