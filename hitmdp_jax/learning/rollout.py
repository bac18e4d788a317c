"""One rollout for every agent: an option is just policy memory."""

from typing import Any, Protocol

import jax
import jax.numpy as jnp
from brax.training.acme.running_statistics import NestedMeanStd
from flax import struct

from hitmdp_jax.envs.vector import Step, VectorEnv, VectorState
from hitmdp_jax.learning.normalization import normalize
from hitmdp_jax.precision import in_32_bits

# Of a `Batch`, by `Step`.
OUTCOME = ("next_obs", "reward", "terminated", "truncated", "started", "option_reward")


class Actor(Protocol):
    """The half of an agent that a rollout needs; see `agents.base.Agent`."""

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start."""
        ...

    def act(
        self, params: Any, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any, Any]:
        """Return (action, memory, record)."""
        ...


class RolloutState(struct.PyTreeNode):
    """What a rollout hands to the next one."""

    env: VectorState
    memory: Any  # [B, ...]


class Batch(struct.PyTreeNode):
    """A rollout as an agent's update reads it: T steps of B environments."""

    obs: jax.Array  # [T, B, O] as the environments showed them; see `normalized`
    next_obs: jax.Array  # [T, B, O] the state reached, before any reset
    action: jax.Array  # [T, B, A]
    memory: Any  # [T, B, ...] what the agent remembered when it acted
    record: Any  # [T, B, ...] what the agent noted when it acted
    reward: jax.Array  # [T, B]
    terminated: jax.Array  # [T, B] bool
    truncated: jax.Array  # [T, B] bool
    started: jax.Array  # [T, B] bool, the first step of an episode
    normalizer: NestedMeanStd | None = None  # with which the policy saw them; None: as they are
    option_reward: jax.Array | None = None  # [T, B, n] by `Agent.option_rewards`; None of none
    replay: Any = ()  # the agent's own, this rollout in it already; see `Agent.init_replay`

    def normalized(self) -> "Batch":
        """Return the rollout with its observations as the policy saw them."""
        return self.replace(
            obs=normalize(self.obs, self.normalizer),
            next_obs=normalize(self.next_obs, self.normalizer),
            normalizer=None,
        )


def collect(
    agent: Actor,
    params: Any,
    normalizer: NestedMeanStd | None,
    env: VectorEnv,
    state: RolloutState,
    key: jax.Array,
    length: int,
) -> tuple[RolloutState, Batch, Step]:
    """Run the policy for `length` steps in every environment.

    The normaliser is frozen meanwhile, so that the update sees the log-probabilities the rollout
    had; update it with the batch's observations afterwards.

    Args:
      agent: the policy.
      params: its parameters.
      normalizer: statistics the observations are normalised with; None leaves them as they are.
      env: B environments.
      state: where the last rollout stopped.
      key: PRNG key.
      length: T.

    Returns:
      The new state, the batch and the environments' steps [T, B].
    """

    def step(carry: RolloutState, key: jax.Array):
        key_act, key_memory = jax.random.split(key)
        obs, memory = env.observation(carry.env), carry.memory
        acted = agent.act(params, normalize(obs, normalizer), memory, key_act)
        action, new_memory, record = in_32_bits(acted)
        env_state, outcome = env.step(carry.env, action)
        ended = outcome.terminated | outcome.truncated
        fresh = in_32_bits(agent.initial_memory(key_memory, ended.shape))
        new_memory = where_ended(ended, fresh, new_memory)
        return RolloutState(env_state, new_memory), (obs, memory, action, record, outcome)

    state, (obs, memory, action, record, outcome) = jax.lax.scan(
        step, state, jax.random.split(key, length)
    )
    seen = {"obs": obs, "action": action, "memory": memory, "record": record}
    led_to = {name: getattr(outcome, name) for name in OUTCOME}
    return state, Batch(**seen, **led_to, normalizer=normalizer), outcome


def where_ended(ended: jax.Array, fresh: Any, memory: Any) -> Any:
    """Return a memory [B, ...], a fresh one where the episode [B] has ended."""

    def choose(new: jax.Array, old: jax.Array) -> jax.Array:
        return jnp.where(ended.reshape(-1, *([1] * (old.ndim - 1))), new, old)

    return jax.tree.map(choose, fresh, memory)
