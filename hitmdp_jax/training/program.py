"""The training program: pure functions of a key that jit, vmap and scan."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env
from brax.training.acme.running_statistics import RunningStatisticsState
from flax import struct

from hitmdp_jax.agents.base import Agent, LearnerState, check_hyperparameters
from hitmdp_jax.envs.wrappers import Step, VectorEnv
from hitmdp_jax.errors import UsageError, out_of_domain
from hitmdp_jax.learning.metrics import Metrics, over_iterations
from hitmdp_jax.learning.normalization import initial_statistics, update_statistics
from hitmdp_jax.learning.rollout import RolloutState, collect


class TrainState(struct.PyTreeNode):
    """Everything a training run consists of: continuing from it is exact."""

    learner: LearnerState
    normalizer: RunningStatisticsState
    rollout: RolloutState
    key: jax.Array
    iteration: jax.Array  # int32


Init = Callable[[jax.Array], TrainState]
Iterate = Callable[[TrainState], tuple[TrainState, Metrics]]


def num_iterations(num_steps: int, num_envs: int, rollout_length: int) -> int:
    """Return how many iterations cover `num_steps` environment steps, the last one whole."""
    return -(-num_steps // (num_envs * rollout_length))


def check_sizes(agent: Agent, num_steps: int, num_envs: int, rollout_length: int) -> None:
    """Reject sizes that no program can be built from.

    Raises:
      UsageError: a size is not positive, or a rollout does not divide into minibatches.
    """
    sizes = {"num_steps": num_steps, "num_envs": num_envs, "rollout_length": rollout_length}
    for name, size in sizes.items():
        if size < 1:
            raise out_of_domain(name, size, "a positive whole number")
    spelled = f"rollout_length * num_envs = {rollout_length} * {num_envs}"
    agent.check_batch(rollout_length * num_envs, spelled)


def make_train(
    agent: Agent,
    env: Env,
    *,
    num_steps: int,
    num_envs: int = 16,
    rollout_length: int = 128,
    episode_length: int | None = None,
    reset_pool_size: int | None = None,
    stagger: bool = True,
) -> tuple[Init, Iterate]:
    """Build one training run as two pure functions.

    Args:
      agent: the algorithm and its hyperparameters, which may be traced.
      env: an environment of Brax's or MuJoCo Playground's interface, unbatched, no auto-reset.
      num_steps: environment steps of the whole run; what a schedule counts against.
      num_envs: B, environments stepped side by side.
      rollout_length: T, steps of each environment an iteration.
      episode_length: time limit in steps; None takes the task's own.
      reset_pool_size: fresh initial states drawn an iteration; None takes a quarter of its steps.
      stagger: start the first episodes at random points of the time limit.

    Returns:
      `init(key) -> TrainState` and `step(TrainState) -> (TrainState, metrics)`, one iteration:
      collect a rollout, update the normaliser and the agent. Metrics are scalars and [K] counts.

    Raises:
      UsageError: a size is not positive or does not divide, a hyperparameter is out of range, or an
        observation is not one array.
    """
    check_hyperparameters(agent)
    check_sizes(agent, num_steps, num_envs, rollout_length)
    pool_size = reset_pool_size or max(1, num_envs * rollout_length // 4)
    vector_env = VectorEnv(env, num_envs, pool_size, episode_length, stagger)
    observation_size, action_size = env.observation_size, env.action_size
    if not isinstance(observation_size, int):
        raise UsageError(
            "The environment observes several arrays, and a policy reads one: "
            "pass an environment whose observation is a single array."
        )

    iterations = num_iterations(num_steps, num_envs, rollout_length)

    def init(key: jax.Array) -> TrainState:
        key, key_agent, key_env, key_memory = jax.random.split(key, 4)
        return TrainState(
            learner=agent.init(key_agent, observation_size, action_size),
            normalizer=initial_statistics(observation_size),
            rollout=RolloutState(
                vector_env.reset(key_env), agent.initial_memory(key_memory, (num_envs,))
            ),
            key=key,
            iteration=jnp.zeros((), jnp.int32),
        )

    def step(state: TrainState) -> tuple[TrainState, Metrics]:
        now = agent.scheduled(state.iteration / iterations)
        key, key_rollout, key_update = jax.random.split(state.key, 3)
        rollout, batch, outcome, obs = collect(
            now,
            state.learner.params,
            state.normalizer,
            vector_env,
            state.rollout,
            key_rollout,
            rollout_length,
        )
        learner, metrics = now.update(state.learner, batch, key_update)
        normalizer = update_statistics(state.normalizer, obs)
        state = TrainState(learner, normalizer, rollout, key, state.iteration + 1)
        return state, episode_metrics(outcome) | metrics

    return init, step


def train(
    agent: Agent,
    env: Env,
    key: jax.Array,
    *,
    num_steps: int,
    num_envs: int = 16,
    rollout_length: int = 128,
    **options: Any,
) -> tuple[TrainState, Metrics]:
    """Run a whole training run as one function of a key, to be jitted and vmapped.

    `jax.vmap(lambda agent, key: train(agent, env, key, num_steps=n))` runs a sweep.

    Args:
      agent: the algorithm and its hyperparameters, which may be traced.
      env: a Brax environment, unbatched and without auto-reset.
      key: PRNG key; the run is a function of it.
      num_steps: environment steps.
      num_envs: environments stepped side by side.
      rollout_length: steps of each environment an iteration.
      **options: further arguments of `make_train`.

    Returns:
      The final state, and the metrics of every iteration [iterations, ...].

    Raises:
      UsageError: a size is not positive or does not divide.
    """
    sizes = {"num_steps": num_steps, "num_envs": num_envs, "rollout_length": rollout_length}
    init, step = make_train(agent, env, **sizes, **options)
    iterations = num_iterations(**sizes)
    return jax.lax.scan(lambda state, _: step(state), init(key), length=iterations)


def repeat(step: Iterate, count: int) -> Iterate:
    """Return `count` iterations as one, with their metrics summed up.

    Algorithms that update every few steps would spend their time reporting.
    """
    if count == 1:
        return step

    def steps(state: TrainState) -> tuple[TrainState, Metrics]:
        state, metrics = jax.lax.scan(lambda s, _: step(s), state, length=count)
        return state, over_iterations(metrics)

    return steps


def transfer(old: TrainState, new: TrainState) -> TrainState:
    """Carry what was learned over to another task's fresh state.

    Networks, optimiser and observation normaliser go on; environments, memory and the episodes in
    progress start anew (DAC, Zhang & Whiteson 2019, sec. 5.2, without its carried-over episodes).
    """
    return new.replace(
        learner=old.learner, normalizer=old.normalizer, key=old.key, iteration=old.iteration
    )


def episode_metrics(outcome: Step) -> Metrics:
    """Return the means over whole episodes that ended in a rollout; NaN where none did.

    `episode_return` is undiscounted and raw, of the stochastic training policy.
    """
    count = outcome.finished.sum()

    def mean(x: jax.Array) -> jax.Array:
        total = jnp.where(outcome.finished, x, 0).sum()
        return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)

    return {
        "episode_return": mean(outcome.episode_return),
        "episode_length": mean(outcome.episode_length),
        "episodes": count,
    } | {name: x.mean() for name, x in outcome.metrics.items()}
