"""An agent whose option is its action, and a task that pays for it: returns are known exactly."""

import distrax
import jax
import jax.numpy as jnp
from brax.envs.base import Env, State

from hitmdp_jax.agents import Agent
from hitmdp_jax.agents.base import LearnerState, static
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from tests.probes import spec_of_sizes


class Obvious(Agent):
    """Takes action o under option o, in truth o plus a noise of nothing; prefers the last option.

    Options alternate: o_t = o_{t-1} + 1 mod K. Memory: o_t that is due, drawn at the start.
    """

    num_options: int = static(3)

    def init(self, key, spec):
        return LearnerState((), ())

    def initial_memory(self, key, batch_shape=()):
        return jax.random.randint(key, batch_shape, 0, self.num_options)

    def act(self, params, obs, memory, key, deterministic=False):
        action = self.policy(params, obs, memory).sample(seed=key)
        return action, (memory + 1) % self.num_options, memory

    def update(self, state, batch, key):
        raise NotImplementedError

    def option_of(self, record):
        return record

    def policy(self, params, obs, option):
        mean = jnp.broadcast_to(option, jnp.broadcast_shapes(obs.shape[:-1], option.shape))
        mean = mean[..., None].astype(float)
        return distrax.MultivariateNormalDiag(mean, jnp.full_like(mean, 1e-6))


class Payment(Env):
    """Pays the action at each of seven steps. Observes a number drawn at the start and the time."""

    episode_length = 7
    observation_size = 2
    action_size = 1
    backend = "none"

    def reset(self, rng):
        zero = jnp.zeros(())
        return State(None, jnp.stack([jax.random.uniform(rng), zero]), zero, zero)

    def step(self, state, action):
        return state.replace(obs=state.obs.at[1].add(1.0), reward=action[0])


def obvious(num_options=3):
    return Policy(
        Obvious(num_options=num_options, spec=spec_of_sizes(2, 1)), (), initial_statistics(2)
    )
