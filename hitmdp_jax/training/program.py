"""The training program: pure functions of a key that jit, vmap and scan."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env
from brax.training.acme.running_statistics import RunningStatisticsState
from flax import struct
from jax.custom_batching import custom_vmap
from jax.flatten_util import ravel_pytree

from hitmdp_jax.agents.base import Agent, LearnerState, check_hyperparameters
from hitmdp_jax.agents.contract import check_algorithm
from hitmdp_jax.checks import check_size
from hitmdp_jax.envs.action_repeat import ActionRepeat, action_repeat_of
from hitmdp_jax.envs.contract import check_task
from hitmdp_jax.envs.spec import Spec, spec_of
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.errors import out_of_domain
from hitmdp_jax.learning.episodes import EpisodeWindow, episode_metrics
from hitmdp_jax.learning.normalization import initial_statistics, update_statistics
from hitmdp_jax.learning.rollout import RolloutState, collect
from hitmdp_jax.metrics import Metrics, describe, over_iterations
from hitmdp_jax.precision import in_32_bits

# What was not finite where a seed diverged. Checkpoints hold the place: new ones go to the end.
CAUSES = (
    "none", "reward", "loss", "parameters", "observation", "observation statistics", "policy"
)  # fmt: skip

POOL_ACTIONS = 32  # in each environment, at least, between two drawings of fresh initial states

Hyperparameters = dict[str, jax.Array]  # float hyperparameter -> its value


class TrainState(struct.PyTreeNode):
    """Everything a training run consists of: continuing from it is exact."""

    hyperparameters: Hyperparameters  # of this training, in place of the agent's own
    learner: LearnerState
    replay: Any  # what an off-policy agent remembers of rollouts; () of the others
    normalizer: RunningStatisticsState
    rollout: RolloutState
    episodes: EpisodeWindow
    key: jax.Array
    iteration: jax.Array  # int32
    diverged: jax.Array  # int32, the iteration that was not finite; 0 while all are
    cause: jax.Array  # int32, the place in CAUSES of what was not finite
    spec: Spec = struct.field(pytree_node=False)  # of the task


Init = Callable[..., TrainState]  # of a key and, in place of the agent's, of `Hyperparameters`
Iterate = Callable[[TrainState], tuple[TrainState, Metrics]]


def num_iterations(
    num_steps: int, num_envs: int, rollout_length: int, action_repeat: int = 1
) -> int:
    """Return how many iterations cover `num_steps` environment steps, the last one whole.

    Environment steps are control steps: `action_repeat` to an action.
    """
    return -(-num_steps // (num_envs * rollout_length * action_repeat))


def pool_period(rollout_length: int) -> int:
    """Return after how many iterations fresh initial states are drawn again.

    An agent that updates at every step would spend its time on drawing them.
    """
    return -(-POOL_ACTIONS // rollout_length)


def usual_pool_size(num_envs: int, rollout_length: int) -> int:
    """Return how many fresh initial states are drawn at once: a quarter of the steps until then."""
    return max(1, num_envs * rollout_length * pool_period(rollout_length) // 4)


def check_sizes(agent: Agent, num_steps: Any, num_envs: Any, rollout_length: Any) -> None:
    """Reject sizes that no program can be built from.

    Raises:
      UsageError: a size is not a positive whole number, or a rollout does not divide into
        minibatches.
    """
    sizes = {"num_steps": num_steps, "num_envs": num_envs, "rollout_length": rollout_length}
    for name, size in sizes.items():
        check_size(name, size)
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
      num_steps: environment steps of the whole run, `action_repeat` to an action where the task
        holds them; what a schedule counts against.
      num_envs: B, environments stepped side by side.
      rollout_length: T, actions in each environment an iteration.
      episode_length: time limit in control steps; None takes the task's own.
      reset_pool_size: fresh initial states drawn at once (`pool_period`); None takes
        `usual_pool_size`.
      stagger: start the first episodes at random points of the time limit.

    Returns:
      `init(key, hyperparameters={}) -> TrainState` and `step(TrainState) -> (TrainState, metrics)`,
      one iteration: collect a rollout, update the normaliser and the agent. Metrics are scalars and
      [K] counts. Hyperparameters by name replace the agent's own and stay with the state.

    Raises:
      UsageError: a size is not positive or does not divide, a hyperparameter is out of range, or
        arrays of an environment or algorithm of your own are not what they should be.
    """
    check_hyperparameters(agent)
    check_sizes(agent, num_steps, num_envs, rollout_length)
    for name, size in (("episode_length", episode_length), ("reset_pool_size", reset_pool_size)):
        if size is not None:
            check_size(name, size)
    task = env.env if isinstance(env, ActionRepeat) else env
    check_task(task, f"env = {env!r}" if isinstance(env, type | str) else type(env).__name__)
    agent = agent.bind(spec_of(env))
    check_algorithm(agent, num_envs, rollout_length)
    pool_size = reset_pool_size or usual_pool_size(num_envs, rollout_length)
    vector_env = VectorEnv(env, num_envs, pool_size, episode_length, stagger)
    iterations = num_iterations(num_steps, num_envs, rollout_length, action_repeat_of(env))
    program = Program(agent, vector_env, rollout_length, iterations)
    return program.init, program.step


@dataclasses.dataclass(frozen=True)
class Program:
    """One training run: its start and its iteration."""

    agent: Agent
    env: VectorEnv
    rollout_length: int
    iterations: int  # of the whole run

    def init(self, key: jax.Array, hyperparameters: Hyperparameters | None = None) -> TrainState:
        """Return the state before the first iteration."""
        hyperparameters = hyperparameters or {}
        agent = self.agent.replace(**hyperparameters)
        key, key_agent, key_env, key_memory = jax.random.split(key, 4)
        spec = self.env.spec
        memory = in_32_bits(agent.initial_memory(key_memory, (self.env.num_envs,)))
        zero = jnp.zeros((), jnp.int32)
        state = TrainState(
            hyperparameters=hyperparameters,
            learner=in_32_bits(agent.init(key_agent, spec)),
            replay=in_32_bits(agent.init_replay(spec)),
            normalizer=initial_statistics(spec.observation.size),
            rollout=RolloutState(self.env.reset(key_env), memory),
            episodes=EpisodeWindow.empty(),
            key=key,
            iteration=zero,
            diverged=zero,
            cause=zero,
            spec=spec,
        )
        # Each field has memory of its own, so that a step may be given all of it (donated).
        return jax.tree.map(jnp.copy, state)

    def refilled(self, state: TrainState, key: jax.Array) -> RolloutState:
        """Return where the last rollout stopped, with fresh initial states if new ones are due."""
        rollout, period = state.rollout, pool_period(self.rollout_length)
        if period == 1:
            return rollout.replace(env=self.env.refill(rollout.env, key))
        env = jax.lax.cond(
            for_all(state.iteration % period == 0),
            lambda env: self.env.refill(env, key),
            lambda env: env,
            rollout.env,
        )
        return rollout.replace(env=env)

    def step(self, state: TrainState) -> tuple[TrainState, Metrics]:
        """Collect a rollout with the agent as it is at this point of the run, and learn from it."""
        key, key_rollout, key_update = jax.random.split(state.key, 3)
        agent = self.agent.replace(**state.hyperparameters)
        agent = agent.scheduled(state.iteration / self.iterations)
        key_pool, key_steps = jax.random.split(key_rollout)
        rollout, batch, outcome = collect(
            agent,
            state.learner.params,
            state.normalizer,
            self.env,
            self.refilled(state, key_pool),
            key_steps,
            self.rollout_length,
        )
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


@custom_vmap
def for_all(due: jax.Array) -> jax.Array:
    """Return a bool that all trainings of a program share: a `cond` on it stays one under `vmap`.

    The trainings of a program count their iterations alike, so what is due is due for all.
    """
    return due


@for_all.def_vmap
def _for_all_mapped(size: int, mapped: list[bool], due: jax.Array) -> tuple[jax.Array, bool]:
    del size, mapped
    return for_all(due.any()), False


def watched(learning: Metrics, cause: str) -> list[jax.Array]:
    """Return those of an algorithm's metrics of which one that is not finite has that cause."""
    return [x for name, x in sorted(learning.items()) if describe(name).cause == cause]


def freeze_diverged(
    old: TrainState, new: TrainState, metrics: Metrics, seen: dict[str, Any]
) -> tuple[TrainState, Metrics]:
    """Keep what a run had learned when it is no longer finite; its metrics are NaN from then on.

    A NaN would stay in the parameters or the normaliser for ever, and take what was learned with
    it. The replay is large and is left alone: nothing is learned from it any more. Nothing is
    shared between the runs of a sweep, so the others go on as they would alone.

    Args:
      old: the state before the iteration.
      new: the state after it.
      metrics: the iteration's.
      seen: what must be finite, by its name in `CAUSES`; of several the first is the cause.
    """
    finite = jnp.stack([jnp.isfinite(ravel_pytree(part)[0]).all() for part in seen.values()])
    lost = (old.diverged > 0) | ~finite.all()
    first = (old.diverged == 0) & ~finite.all()
    causes = jnp.array([CAUSES.index(name) for name in seen], jnp.int32)

    def keep(before: Any, after: Any) -> Any:
        return jax.tree.map(lambda a, b: jnp.where(lost, a, b), before, after)

    state = new.replace(
        learner=keep(old.learner, new.learner),
        normalizer=keep(old.normalizer, new.normalizer),
        diverged=jnp.where(first, new.iteration, old.diverged),
        cause=jnp.where(first, causes[jnp.argmin(finite)], old.cause),
    )

    def nothing(name: str, x: jax.Array) -> jax.Array:
        return jnp.zeros_like(x) if describe(name).over_iterations == "sum" else x * jnp.nan

    told = {name: jnp.where(lost, nothing(name, x), x) for name, x in metrics.items()}
    return state, told | {"diverged": lost}


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
      rollout_length: actions in each environment an iteration.
      **options: further arguments of `make_train`.

    Returns:
      The final state, and the metrics of every iteration [iterations, ...].

    Raises:
      UsageError: a size is not positive or does not divide.
    """
    sizes = {"num_steps": num_steps, "num_envs": num_envs, "rollout_length": rollout_length}
    init, step = make_train(agent, env, **sizes, **options)
    if not hasattr(key, "dtype"):
        raise out_of_domain("key", key, "a key, such as jax.random.key(0)")
    iterations = num_iterations(**sizes, action_repeat=action_repeat_of(env))
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


def transfer(old: TrainState, new: TrainState) -> TrainState:
    """Carry what was learned over to another task's fresh state.

    Networks, optimiser and observation normaliser go on; environments, memory, the replay and the
    episodes in progress start anew (DAC, Zhang & Whiteson 2019, sec. 5.2, without its carried-over
    episodes).
    """
    return new.replace(
        hyperparameters=old.hyperparameters,
        learner=old.learner,
        normalizer=old.normalizer,
        key=old.key,
        iteration=old.iteration,
        diverged=old.diverged,
        cause=old.cause,
    )
