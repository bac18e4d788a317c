"""Tiny environments with known answers, and a quick run."""

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State
from flax import struct

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.agents.base import static
from hitmdp_jax.envs.spec import Box, Observation, Spec
from hitmdp_jax.envs.suites.toy.turkey import Turkey
from hitmdp_jax.learning import replay as replays
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from hitmdp_jax.training.sweep import Training

# A run that compiles quickly. Wherever another one is not the point it is this one, so that its
# program is compiled once for all, in the tests' process and in those that they start.
QUICK = {
    "algo": {"name": "ppo", "num_epochs": 1, "hidden_sizes": [8], "minibatch_size": 2048},
    "env": {"name": "invertedpendulum"},
    "physics": "native",
}


def spec_of_sizes(observations, actions):
    """Return what a task says of itself that shows and takes so many numbers."""
    return Spec(Observation((observations,)), Box.unlimited(actions))


def untrained_policy(agent, key):
    """Return what an agent, bound to a task, does before it learns."""
    normalizer = initial_statistics(agent.spec.observation.size)
    return Policy(agent, jax.jit(lambda key: agent.init(key, agent.spec).params)(key), normalizer)


class Target(Env):
    """The observation is a number in [-1, 1]; the reward for action a is 1 - (a - x)^2.

    Each episode is one step long and terminates. The best return is 1 and every state's value
    under a policy is its expected reward.
    """

    episode_length = 10

    def reset(self, rng):
        x = jax.random.uniform(rng, (1,), minval=-1.0, maxval=1.0)
        zero = jnp.zeros(())
        return State(pipeline_state=None, obs=x, reward=zero, done=zero)

    def step(self, state, action):
        reward = 1.0 - jnp.square(action[0] - state.obs[0])
        return state.replace(reward=reward, done=jnp.ones(()))

    observation_size = 1
    action_size = 1
    backend = "none"


class Counter(Env):
    """Observes its own clock and its episode's serial number; reward 1 a step; never terminates."""

    episode_length = 5

    def reset(self, rng):
        serial = jax.random.uniform(rng)
        zero = jnp.zeros(())
        return State(None, jnp.stack([zero, serial]), zero, zero)

    def step(self, state, action):
        obs = state.obs.at[0].add(1.0)
        return state.replace(obs=obs, reward=jnp.ones(()), done=(action[0] > 100).astype(float))

    observation_size = 2
    action_size = 1
    backend = "none"


class PlaygroundState(struct.PyTreeNode):
    """The state of MuJoCo Playground's environments, field for field."""

    data: jax.Array
    obs: jax.Array
    reward: jax.Array
    done: jax.Array
    metrics: dict[str, jax.Array]
    info: dict[str, jax.Array]


class PlaygroundTarget:
    """`Target` with the interface of MuJoCo Playground's environments, which are not Brax's."""

    observation_size = 1
    action_size = 1

    def reset(self, rng):
        x = jax.random.uniform(rng, (1,), minval=-1.0, maxval=1.0)
        zero = jnp.zeros(())
        return PlaygroundState(x, x, zero, zero, {"reward/near": zero}, {"rng": rng})

    def step(self, state, action):
        reward = 1.0 - jnp.square(action[0] - state.obs[0])
        metrics = {"reward/near": reward}
        return state.replace(reward=reward, done=jnp.ones(()), metrics=metrics)


def trainings(count=2, first=0):
    """Return the trainings of a run that sweeps nothing."""
    return [Training(first + i, 0, {}) for i in range(count)]


def untrained(agent, seeds, env=None):
    """Return zeros in the shape of a training state [S, ...], which needs no compiling."""
    init, _ = hitmdp_jax.make_train(agent, env or Turkey(), num_steps=2048)
    keys = jax.random.split(jax.random.key(0), seeds)
    shapes = jax.eval_shape(jax.vmap(init), keys)
    zeros = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), shapes.replace(key=()))
    return zeros.replace(key=keys)


class Remembering(PPO):
    """PPO that also remembers, as off-policy agents do: its metric is the mean of old rewards."""

    capacity: int = static(64)

    def init_replay(self, spec):
        return replays.empty((jnp.zeros(spec.observation.size), jnp.zeros(())), self.capacity)

    def store(self, replay, batch):
        steps = batch.reward.size
        return replays.add(replay, (batch.obs.reshape(steps, -1), batch.reward.reshape(steps)))

    def update(self, state, batch, key):
        _, rewards = replays.sample(batch.replay, key, 32)
        state, metrics = super().update(state, batch, key)
        return state, metrics | {"remembered": rewards.mean()}
