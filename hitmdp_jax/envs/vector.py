"""`VectorEnv`: many environments with a time limit, true random resets and final observations."""

import copy
from collections.abc import Mapping

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State
from flax import struct

from hitmdp_jax.envs.action_repeat import steps_taken
from hitmdp_jax.envs.numbers import with_numbers
from hitmdp_jax.envs.option_rewards import check_option_rewards, option_rewards
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.mesh import each_device, in_chunks, on_every_device
from hitmdp_jax.precision import as_before, in_32_bits

# Initial states computed together. Hundreds at once can block XLA's threads: see `set_up_host`.
RESET_CHUNK = 32


class VectorState(struct.PyTreeNode):
    """State of B environments and the pool of P fresh initial states they restart from."""

    env: State  # [B, ...]
    clock: jax.Array  # [B] int32, control steps towards the time limit
    episode_return: jax.Array  # [B] undiscounted reward of the running episode
    episode_length: jax.Array  # [B] int32, control steps of the running episode
    pool: State  # [P, ...]
    next_fresh: jax.Array  # int32, the first state of the pool not yet used


class Step(struct.PyTreeNode):
    """What one step of B environments yields. All fields are [B] or [B, ...]."""

    reward: jax.Array
    terminated: jax.Array  # bool: the task ended the episode
    truncated: jax.Array  # bool: a time limit did, ours or the task's own
    next_obs: jax.Array  # [B, O] the observation reached, before any reset
    episode_return: jax.Array  # of the episode so far; final where `finished`
    episode_length: jax.Array  # control steps, several to an action under `ActionRepeat`
    started: jax.Array  # bool: the first step of an episode
    finished: jax.Array  # bool: a whole episode ended here
    metrics: dict[str, jax.Array]  # the task's reward terms
    option_reward: jax.Array | None = None  # [B, n] by `VectorEnv.option_rewards`; None of none


class VectorEnv:
    """Steps B copies of an environment and restarts each finished one from a NEW random state.

    `jax.vmap` turns a conditional reset into a reset at every step, which physics with derived
    fields cannot afford. So a pool of P fresh initial states is drawn once per rollout (`refill`),
    each used once and in order; only if more than P episodes end between two refills is one used
    twice.

    Args:
      env: the task, unbatched and without auto-reset.
      num_envs: B.
      pool_size: P.
      episode_length: time limit in control steps; None takes the task's own.
      stagger: start the first episodes at random points of the time limit, so that tasks without
        termination do not all end together for ever. Such shortened episodes are not reported.
      option_rewards: names of rewards that each step also pays to options.

    Raises:
      UsageError: the task does not offer one of those rewards.
    """

    def __init__(
        self,
        env: Env,
        num_envs: int,
        pool_size: int,
        episode_length: int | None = None,
        stagger: bool = True,
        option_rewards: tuple[str, ...] = (),
    ):
        self.env = env
        self.num_envs = num_envs
        self.pool_size = pool_size
        self.spec = spec_of(env)
        self.episode_length = episode_length or self.spec.episode_length
        self.stagger = stagger
        check_option_rewards(env, option_rewards)
        self.option_rewards = option_rewards

    def with_numbers(self, numbers: Mapping[str, jax.Array]) -> "VectorEnv":
        """Return the same with other numbers of the task; Raises as `numbers.with_numbers`."""
        if not numbers:
            return self
        changed = copy.copy(self)
        changed.env = with_numbers(self.env, numbers)
        return changed

    def reset(self, key: jax.Array) -> VectorState:
        """Start every environment."""
        key_env, key_pool, key_clock = jax.random.split(key, 3)
        states = each_device(jax.vmap(self.env.reset), jax.random.split(key_env, self.num_envs))
        zeros = jnp.zeros(self.num_envs, jnp.float32)
        clock = jax.random.randint(key_clock, (self.num_envs,), 0, self.episode_length, jnp.int32)
        return VectorState(
            env=states,
            clock=clock if self.stagger else jnp.zeros_like(clock),
            episode_return=zeros,
            episode_length=zeros.astype(jnp.int32),
            pool=self._fresh(key_pool),
            next_fresh=jnp.zeros((), jnp.int32),
        )

    def observation(self, state: VectorState) -> jax.Array:
        """Return the current observations of all environments, [B, O]."""
        return self.spec.observation.flat(state.env.obs)

    def refill(self, state: VectorState, key: jax.Array) -> VectorState:
        """Draw a new pool of initial states."""
        return state.replace(pool=self._fresh(key), next_fresh=jnp.zeros((), jnp.int32))

    def step(self, state: VectorState, action: jax.Array) -> tuple[VectorState, Step]:
        """Step every environment under `action` [B, A]; restart those whose episode ended."""
        env = as_before(each_device(jax.vmap(self.env.step), state.env, action), state.env)
        reward, metrics = in_32_bits((env.reward, env.metrics))
        taken = steps_taken(state.env, env)
        clock = state.clock + taken
        length = state.episode_length + taken
        episode_return = state.episode_return + reward
        done = env.done.astype(bool)
        terminated = done & ~_says_truncated(env)
        ended = done | (clock >= self.episode_length)
        truncated = ended & ~terminated
        step = Step(
            reward=reward,
            terminated=terminated,
            truncated=truncated,
            next_obs=self.spec.observation.flat(env.obs),
            episode_return=episode_return,
            episode_length=length,
            started=state.episode_length == 0,
            finished=ended & (clock == length),
            metrics=metrics,
            option_reward=self._option_reward(state.env, action, env, reward),
        )
        # Its rank among those that ended in this step: summed up once they are all there.
        rank = on_every_device(jnp.cumsum(on_every_device(ended), dtype=jnp.int32))
        fresh_index = (state.next_fresh + rank - 1) % self.pool_size

        def restart(fresh: jax.Array, running: jax.Array) -> jax.Array:
            mask = ended.reshape(-1, *([1] * (running.ndim - 1)))
            return jnp.where(mask, fresh[fresh_index], running)

        state = state.replace(
            env=jax.tree.map(restart, state.pool, env),
            clock=jnp.where(ended, 0, clock),
            episode_return=jnp.where(ended, 0.0, episode_return),
            episode_length=jnp.where(ended, 0, length),
            next_fresh=(state.next_fresh + rank[-1]) % self.pool_size,
        )
        return state, step

    def _option_reward(
        self, before: State, action: jax.Array, after: State, reward: jax.Array
    ) -> jax.Array | None:
        if not self.option_rewards:
            return None
        return option_rewards(self.env, self.option_rewards, before, action, after, reward)

    def _fresh(self, key: jax.Array) -> State:
        def resets(keys: jax.Array) -> State:
            return in_chunks(self.env.reset, keys, RESET_CHUNK)

        pool = each_device(resets, jax.random.split(key, self.pool_size))
        return on_every_device(pool)  # any environment may restart from any of it


def _says_truncated(env: State) -> jax.Array:
    """Return whether environments [B] say that what ended an episode was a time limit."""
    said = env.info.get("truncation")  # the word of Brax's and MuJoCo Playground's wrappers
    return jnp.zeros(env.done.shape, bool) if said is None else said.astype(bool)
