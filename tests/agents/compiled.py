"""Agents whose methods are compiled, once a test run, instead of run one operation at a time."""

import functools
from typing import Any

import jax

from tests.programs import compiled

# Not those that return a distribution, which no program can.
METHODS = {
    "act",
    "every_q",
    "heads",
    "infer",
    "information",
    "log_prob",
    "loss",
    "high_loss",
    "low_loss",
    "option_log_probs",
    "option_probs",
    "q",
    "targets",
    "update",
    "value",
    "value_upon_arrival",
    "values",
}


class Compiled:
    """An agent with compiled methods; agents of one class and static settings share programs."""

    def __init__(self, agent: Any):
        self.agent = agent

    def __getattr__(self, name: str) -> Any:
        if name in METHODS:
            return functools.partial(_call, name, self.agent)
        if name == "init":
            return functools.partial(_init, self.agent)
        return getattr(self.agent, name)

    def replace(self, **changes: Any) -> "Compiled":
        return Compiled(self.agent.replace(**changes))


@functools.partial(compiled, static_argnums=0, static_argnames="deterministic")
def _call(name: str, agent: Any, *arguments: Any, **keywords: Any) -> Any:
    return getattr(agent, name)(*arguments, **keywords)


@functools.partial(compiled, static_argnums=2)
def _init(agent: Any, key: jax.Array, spec: Any) -> Any:
    return agent.init(key, spec)
