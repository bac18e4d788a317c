"""The functions of the theory, each compiled once for all tests: `exact.evaluate(model)`."""

import functools
import importlib
from typing import Any

from hitmdp_jax import theory
from tests.programs import compiled

HIT_MDP = importlib.import_module("hitmdp_jax.theory.hit_mdp")  # a function has its name, too

STATIC = {  # arguments that shape the program, by place
    "deep_value": 1,
    "distances_to_fixed_point": 1,
    "elbo_objective": 2,
    "enumerate_trajectories": (0, 1, 2, 3),
    "evidence": 2,
    "one_hot": 1,
    "policy_iteration": 1,
    "sample_option_model": (1, 2, 3),
    "sticky_prior": 0,
}


@functools.cache
def __getattr__(name: str) -> Any:
    function = getattr(theory, name, None) or getattr(HIT_MDP, name)
    return compiled(function, static_argnums=STATIC.get(name, ()))
