"""The protocol that every algorithm implements, and the state it learns."""

import dataclasses
import math
from typing import Any, Protocol

import jax
from flax import struct

from hitmdp_jax.errors import out_of_domain, unknown_name
from hitmdp_jax.learning.rollout import Batch

Metrics = dict[str, jax.Array]


def traced(default: float, low: float = 0.0, high: float = math.inf) -> Any:
    """Declare a float hyperparameter in [low, high]: a pytree leaf that may be traced."""
    return struct.field(default=default, metadata={"low": low, "high": high})


def static(default: Any, choices: tuple[str, ...] = ()) -> Any:
    """Declare a hyperparameter that shapes the program, and so cannot be traced."""
    return struct.field(pytree_node=False, default=default, metadata={"choices": choices})


def check_hyperparameters(agent: Any) -> None:
    """Reject values outside the domains that an agent's fields declare; traced ones pass.

    Raises:
      UsageError: naming the field, its value and what is valid.
    """
    for field in dataclasses.fields(agent):
        value, limits = getattr(agent, field.name), field.metadata
        if "low" in limits:
            known = isinstance(value, int | float)
            if known and not limits["low"] <= value <= limits["high"]:
                wanted = f"a number from {limits['low']:g} to {limits['high']:g}"
                raise out_of_domain(field.name, value, wanted)
        elif limits.get("choices"):
            if value not in limits["choices"]:
                raise unknown_name(field.name, str(value), limits["choices"])
        elif isinstance(field.default, int) and not isinstance(field.default, bool):
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise out_of_domain(field.name, value, "a positive whole number")
        elif isinstance(field.default, tuple) and not (
            value and all(isinstance(size, int) and size > 0 for size in value)
        ):
            raise out_of_domain(field.name, list(value), "a list of positive whole numbers")


class LearnerState(struct.PyTreeNode):
    """What an agent's update changes."""

    params: Any
    opt_state: Any
    extra: Any = ()  # what only some algorithms need: OC's target network


class Agent(Protocol):
    """An algorithm: a frozen dataclass of hyperparameters with pure methods.

    Float fields are pytree leaves, so they may be traced and vmapped; ints, strings and tuples are
    static. An agent with schedules has one more method, `scheduled(progress) -> Agent`: itself
    after that fraction of the run. `memory` is what the policy carries from step to step: nothing
    for PPO, o_{t-1} for MOPG. Every method takes any leading batch shape.
    """

    minibatch_size: int

    def init(self, key: jax.Array, observation_size: int, action_size: int) -> LearnerState:
        """Return new parameters and optimiser state."""
        ...

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start."""
        ...

    def act(
        self, params: Any, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any, Any]:
        """Choose actions for normalised observations [..., O].

        Returns:
          The action [..., A], the new memory, and a record of what else `update` needs.
        """
        ...

    def option_of(self, record: Any) -> jax.Array | None:
        """Return the option [...] that a record of `act` names; None without options."""
        ...

    def option_probs(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array | None:
        """Return P(o_t | s_t, memory) [..., K] for normalised obs; None without options."""
        ...

    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Learn from one rollout."""
        ...
