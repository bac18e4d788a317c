"""A trained agent whose options are told it: what the options do is asked by choosing them."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.agents.base import Agent, LearnerState
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.runs.policy import Policy


class ForcedOptions(Agent):
    """An agent that takes the options of a schedule, and for the rest does as it would.

    Its actions are drawn from the agent's own P(a | s, o) by the same keys: under a schedule of its
    own choices it repeats its own episode. Memory: the number of steps taken. It does not learn.
    """

    agent: Agent = struct.field(pytree_node=True)
    schedule: jax.Array = struct.field(pytree_node=True)  # [T, ...] int; starts over after T steps

    def init(self, key: jax.Array, spec: Spec) -> LearnerState:
        """Return the parameters that the agent itself starts with."""
        return self.agent.init(key, spec)

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> jax.Array:
        """Return the memory of an episode's start: no step taken."""
        return jnp.zeros(batch_shape, jnp.int32)

    def act(
        self,
        params: Any,
        obs: jax.Array,
        memory: jax.Array,
        key: jax.Array,
        deterministic: bool = False,
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Draw a_t under the option that is due; the deterministic policy takes the mode."""
        option = self._due(memory)
        _, key_action = jax.random.split(key)  # as every agent with options splits it
        policy = self.agent.policy(params, obs, option)
        action = policy.mode() if deterministic else policy.sample(seed=key_action)
        return action, memory + 1, option

    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Refuse to learn."""
        raise NotImplementedError("an agent with forced options acts; it does not learn")

    def option_of(self, record: jax.Array) -> jax.Array:
        """Return the options that were executed."""
        return record

    def option_probs(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return 1 for the option that is due, [..., K]."""
        return jax.nn.one_hot(self._due(memory), number_of_options(self.agent), dtype=jnp.float32)

    def policy(self, params: Any, obs: jax.Array, option: jax.Array) -> Any:
        """Return P(a | s, o) of the agent."""
        return self.agent.policy(params, obs, option)

    def _due(self, memory: jax.Array) -> jax.Array:
        step = memory[None] % len(self.schedule)
        return jnp.take_along_axis(self.schedule, step, axis=0)[0]


def force_options(policy: Policy, schedule: jax.Array) -> Policy:
    """Return the policy under a schedule of options.

    Args:
      policy: of an agent with options.
      schedule: [T, ...] int, the option of each step, of a batch of any shape; it starts over after
        T steps.

    Raises:
      UsageError: the agent has no options.
    """
    number_of_options(policy.agent)
    agent = ForcedOptions(policy.agent, schedule, spec=policy.agent.spec)
    return Policy(agent, policy.params, policy.normalizer)


def number_of_options(agent: Agent) -> int:
    """Return K.

    Raises:
      UsageError: the agent has no options, or none that can be chosen from outside.
    """
    if isinstance(agent, ForcedOptions):
        return number_of_options(agent.agent)
    number, kind = getattr(agent, "num_options", None), type(agent)
    if not isinstance(number, int) or kind.policy is Agent.policy:
        raise UsageError(f"{kind.__name__} has no options to look into.")
    return number
