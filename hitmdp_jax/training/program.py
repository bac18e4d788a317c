"""The training program: pure functions of a key that jit, vmap and scan."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env

from hitmdp_jax.agents.base import Agent, check_hyperparameters
from hitmdp_jax.agents.contract import check_algorithm
from hitmdp_jax.checks import check_size
from hitmdp_jax.envs.action_repeat import ActionRepeat, action_repeat_of
from hitmdp_jax.envs.contract import check_task
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.errors import out_of_domain, warn
from hitmdp_jax.learning.episodes import EpisodeWindow, episode_metrics
from hitmdp_jax.learning.normalization import initial_statistics, update_statistics
from hitmdp_jax.learning.rollout import RolloutState, collect
from hitmdp_jax.mesh import for_all
from hitmdp_jax.metrics import Metrics, over_iterations
from hitmdp_jax.precision import in_32_bits
from hitmdp_jax.training.callbacks import Callback, check_callbacks
from hitmdp_jax.training.divergence import freeze_diverged, watched
from hitmdp_jax.training.host_loop import Iterate, check_untraced, train_with
from hitmdp_jax.training.policy import Policy
from hitmdp_jax.training.sizes import (
    check_sizes,
    num_iterations,
    pool_period,
    shortest_episode,
    usual_pool_size,
)
from hitmdp_jax.training.state import Hyperparameters, TrainState
from hitmdp_jax.training.sweep import apart
from hitmdp_jax.training.warm_start import (
    begun,
    check_parts,
    fit,
    learned_of,
    sentence,
)

Init = Callable[..., TrainState]  # of a key and, in place of the agent's, of `Hyperparameters`


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
    init_from: Policy | TrainState | None = None,
    init_parts: Sequence[str] | None = None,
) -> tuple[Init, Iterate]:
    """Build one training run as two pure functions.

    Args:
      agent: the algorithm and its hyperparameters, which may be traced.
      env: an environment of Brax's or MuJoCo Playground's interface, unbatched, no auto-reset.
      num_steps: environment steps of the whole run, `action_repeat` to an action that is held.
      num_envs: B, environments stepped side by side.
      rollout_length: T, actions in each environment an iteration.
      episode_length: time limit in control steps; None takes the task's own.
      reset_pool_size: initial states drawn at once (`pool_period`); None: `usual_pool_size`.
      stagger: start the first episodes at random points of the time limit.
      init_from: the policy or state of a training to begin with; what does not fit starts anew.
      init_parts: of that `policy`, `critic`, `normalizer` and `optimizer`; None takes all.

    Returns:
      `init(key, hyperparameters={}) -> TrainState` and `step(TrainState) -> (TrainState, metrics)`,
      one iteration: collect a rollout, update the normaliser and the agent. Metrics are scalars and
      [K] counts. Hyperparameters by name replace the agent's own, and those named `env.` and a
      keyword the numbers that the task lists in `traced`; they stay with the state.

    Raises:
      UsageError: a size, a hyperparameter, or a task or algorithm of your own is not valid.
    """
    agent = _bound(agent, env)
    check_sizes(agent, num_steps, num_envs, rollout_length)
    for name, size in (("episode_length", episode_length), ("reset_pool_size", reset_pool_size)):
        if size is not None:
            check_size(name, size)
    check_algorithm(agent, num_envs, rollout_length)
    shortest = shortest_episode(env, episode_length)
    pool_size = reset_pool_size or usual_pool_size(num_envs, rollout_length, shortest)
    vector_env = VectorEnv(env, num_envs, pool_size, episode_length, stagger, agent.option_rewards)
    iterations = num_iterations(num_steps, num_envs, rollout_length, action_repeat_of(env))
    period = pool_period(rollout_length, shortest)
    program = Program(agent, vector_env, rollout_length, iterations, period)
    program = _beginning_with(program, init_from, init_parts)
    return program.init, program.step


def _beginning_with(
    program: "Program", init_from: Policy | TrainState | None, init_parts: Sequence[str] | None
) -> "Program":
    """Return a program that begins with what was learned; say what is new. Raises as `fit`."""
    if init_from is None:
        return program
    learned, parts = learned_of(init_from), check_parts(init_parts)
    state = jax.eval_shape(program.init, jax.random.key(0))
    shapes = {name: jnp.shape(x) for name, x in learned.leaves.items()}
    found = fit(state, learned, shapes, parts)
    if told := sentence(found, learned.spec, state.spec):
        warn(f"init_from: {told}")
    taken, leaves = found.taken, learned.leaves
    return dataclasses.replace(program, begin=lambda state: begun(state, taken, leaves))


@dataclasses.dataclass(frozen=True)
class Program:
    """One training run: its start and its iteration."""

    agent: Agent
    env: VectorEnv
    rollout_length: int
    iterations: int  # of the whole run
    pool_period: int  # iterations after which fresh initial states are drawn again
    begin: Callable[[TrainState], TrainState] = lambda state: state  # with what is known already

    def init(self, key: jax.Array, hyperparameters: Hyperparameters | None = None) -> TrainState:
        """Return the state before the first iteration."""
        hyperparameters = hyperparameters or {}
        agent, env = self.under(hyperparameters)
        key, key_agent, key_env, key_memory = jax.random.split(key, 4)
        spec = env.spec
        memory = in_32_bits(agent.initial_memory(key_memory, (env.num_envs,)))
        zero = jnp.zeros((), jnp.int32)
        state = TrainState(
            hyperparameters=hyperparameters,
            learner=in_32_bits(agent.init(key_agent, spec)),
            replay=in_32_bits(agent.init_replay(spec)),
            normalizer=initial_statistics(spec.observation.size),
            rollout=RolloutState(env.reset(key_env), memory),
            episodes=EpisodeWindow.empty(),
            key=key,
            iteration=zero,
            diverged=zero,
            cause=zero,
            spec=spec,
        )
        # Each field has memory of its own, so that a step may be given all of it (donated).
        return jax.tree.map(jnp.copy, self.begin(state))

    def under(self, hyperparameters: Hyperparameters) -> tuple[Agent, VectorEnv]:
        """Return the agent and the environments of a training; Raises as `VectorEnv`'s."""
        of_agent, numbers = apart(hyperparameters)
        return self.agent.replace(**of_agent), self.env.with_numbers(numbers)

    def refilled(self, env: VectorEnv, state: TrainState, key: jax.Array) -> RolloutState:
        """Return where the last rollout stopped, with fresh initial states if new ones are due."""
        rollout, period = state.rollout, self.pool_period
        if period == 1:
            return rollout.replace(env=env.refill(rollout.env, key))
        refilled = jax.lax.cond(
            for_all(state.iteration % period == 0),
            lambda state: env.refill(state, key),
            lambda state: state,
            rollout.env,
        )
        return rollout.replace(env=refilled)

    def step(self, state: TrainState) -> tuple[TrainState, Metrics]:
        """Collect a rollout with the agent as it is at this point of the run, and learn from it."""
        key, key_rollout, key_update = jax.random.split(state.key, 3)
        agent, env = self.under(state.hyperparameters)
        agent = agent.scheduled(state.iteration / self.iterations)
        key_pool, key_steps = jax.random.split(key_rollout)
        rollout, batch, outcome = collect(
            agent,
            state.learner.params,
            state.normalizer if agent.normalize_observations else None,
            env,
            self.refilled(env, state, key_pool),
            key_steps,
            self.rollout_length,
        )
        batch = batch.replace(reward=agent.reward_scale * batch.reward)
        replay = in_32_bits(agent.store(state.replay, batch))
        learner, learning = in_32_bits(
            agent.update(state.learner, batch.replace(replay=replay), key_update)
        )
        new = state.replace(
            learner=learner,
            replay=replay,
            normalizer=update_statistics(state.normalizer, batch.obs),
            rollout=rollout,
            episodes=state.episodes.add(outcome),
            key=key,
            iteration=state.iteration + 1,
        )
        seen = {
            "observation": (batch.obs, batch.next_obs),
            "reward": outcome.reward,
            "observation statistics": new.normalizer,
            "loss": watched(learning, "loss"),
            "policy": watched(learning, "policy"),
            "parameters": learner.params,
        }
        metrics = episode_metrics(outcome) | new.episodes.metrics() | learning
        return freeze_diverged(state, new, in_32_bits(metrics), seen)


def _bound(agent: Agent, env: Env) -> Agent:
    """Return the agent for a task, both found to be what they should be."""
    check_hyperparameters(agent)
    task = env.env if isinstance(env, ActionRepeat) else env
    check_task(task, f"env = {env!r}" if isinstance(env, type | str) else type(env).__name__)
    return agent.bind(spec_of(env))


def train(
    agent: Agent,
    env: Env,
    key: jax.Array,
    *,
    num_steps: int,
    num_envs: int = 16,
    rollout_length: int = 128,
    callbacks: Sequence[Callback] = (),
    stop_at_return: float | None = None,
    **options: Any,
) -> tuple[TrainState, Metrics]:
    """Run a whole training run as one function of a key, to be jitted and vmapped.

    `jax.vmap(lambda agent, key: train(agent, env, key, num_steps=n))` runs a sweep. With callbacks
    or `stop_at_return` the host begins one compiled iteration after the other, so that it can look
    and end the run: then it can be neither jitted nor vmapped.

    Args:
      agent: the algorithm and its hyperparameters, which may be traced.
      env: a Brax environment, unbatched and without auto-reset.
      key: PRNG key; the run is a function of it. With callbacks it may be [R], of several trainings
        side by side, whose results are [R, ...].
      num_steps: environment steps.
      num_envs: environments stepped side by side.
      rollout_length: actions in each environment an iteration.
      callbacks: called after iterations, as often as each says; else their metrics are NaN.
      stop_at_return: end the run once each training's last 100 episodes return as much on average.
      **options: further arguments of `make_train`.

    Returns:
      The final state, and the metrics of every iteration [iterations, ...].

    Raises:
      UsageError: as `make_train`, `callbacks.check_callbacks` and `host_loop.check_untraced`.
    """
    sizes = {"num_steps": num_steps, "num_envs": num_envs, "rollout_length": rollout_length}
    named = ((x, getattr(x, "__name__", type(x).__name__)) for x in callbacks)
    own = check_callbacks(named, stop_at_return)
    if own:
        check_untraced(agent, env, key)
    init, step = make_train(agent, env, **sizes, **options)
    if not hasattr(key, "dtype"):
        raise out_of_domain("key", key, "a key, such as jax.random.key(0)")
    repeats = action_repeat_of(env)
    iterations = num_iterations(**sizes, action_repeat=repeats)
    if own:
        steps = num_envs * rollout_length * repeats
        return train_with(own, agent, init, step, key, iterations=iterations, env_steps=steps)
    return jax.lax.scan(lambda state, _: step(state), init(key), length=iterations)


def repeat(step: Iterate, count: int) -> Iterate:
    """Return `count` iterations as one, with their metrics summed up (`metrics`).

    Algorithms that update every few steps would spend their time reporting.
    """
    if count == 1:
        return step

    def steps(state: TrainState) -> tuple[TrainState, Metrics]:
        state, metrics = jax.lax.scan(lambda s, _: step(s), state, length=count)
        return state, over_iterations(metrics)

    return steps
