"""A world of Craftax, behind Brax's interface."""

import functools
import importlib
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env

from hitmdp_jax.envs.suites.base import with_keywords
from hitmdp_jax.envs.suites.gymnax.task import KeyedTask, numbers_of

WORLDS = {  # name -> the module that holds its constants
    "Craftax-Classic-Symbolic-v1": "craftax.craftax_classic.constants",
    "Craftax-Symbolic-v1": "craftax.craftax.constants",
}
ENDLESS = 2**31 - 1  # steps


class CraftaxTask(KeyedTask):
    """A world of Craftax, which has gymnax's interface but mixes its time limit with death.

    `params` let it run for ever, and the time limit is ours. Each achievement is a metric: 1 in the
    step that unlocks it, so that its sum over an episode says whether it was reached.

    A world takes as long to make as 25 steps. Random actions survive for 41 steps or more.
    """

    shortest_episode = 32

    def __init__(self, name: str, **keywords: Any):
        from craftax.craftax_env import make_craftax_env_from_name

        constants = importlib.import_module(WORLDS[name])
        self._achievements = [(x.value, x.name.lower()) for x in constants.Achievement]
        task: Any = make_craftax_env_from_name(name, auto_reset=False)
        params = task.default_params.replace(**keywords)
        actions = tuple(action.name.lower() for action in constants.Action)
        super().__init__(task, params.replace(max_timesteps=ENDLESS), params.max_timesteps, actions)

    def truncated(self, state: Any) -> jax.Array:
        """Never: the library would call it the end of the episode."""
        return jnp.zeros((), bool)

    def metrics(self, before: Any, after: Any) -> dict[str, jax.Array]:
        """Return the achievements of a step."""
        new = (after.achievements & ~before.achievements).astype(jnp.float32)
        return {f"achieved_{name}": new[i] for i, name in self._achievements}


def constructor(name: str) -> Callable[..., Env]:
    """Return a function that makes a world; its keywords are the fields of the parameters."""
    from craftax.craftax_env import make_craftax_env_from_name

    task: Any = make_craftax_env_from_name(name, auto_reset=False)
    keywords = vars(task.default_params)
    return with_keywords(functools.partial(CraftaxTask, name), keywords, numbers_of(task))
