"""The protocol that every algorithm implements, and the state it learns."""

from typing import Any, Protocol

import jax
from flax import struct

from hitmdp_jax.learning.rollout import Batch

Metrics = dict[str, jax.Array]


def static(default: Any) -> Any:
    """Declare a hyperparameter that shapes the program, and so cannot be traced."""
    return struct.field(pytree_node=False, default=default)


@struct.dataclass
class LearnerState:
    """What an agent's update changes."""

    params: Any
    opt_state: Any


class Agent(Protocol):
    """An algorithm: a frozen dataclass of hyperparameters with pure methods.

    Float fields are pytree leaves, so they may be traced and vmapped; ints, strings and tuples are
    static. `memory` is what the policy carries from step to step: nothing for PPO, o_{t-1} for
    MOPG. Every method takes any leading batch shape.
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

    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Learn from one rollout."""
        ...
