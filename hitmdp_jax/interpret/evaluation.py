"""Scoring a trained policy: whole episodes, in any engine, Gymnasium itself among them."""

import dataclasses
import functools
import json
import math
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.checks import check_memory, whole_number
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.interpret.episodes import run_episodes, run_in_gymnasium
from hitmdp_jax.physics import ENGINES as PHYSICS
from hitmdp_jax.physics import PhysicsChoice
from hitmdp_jax.runs.config import Task
from hitmdp_jax.runs.policy import Policy

ENGINES = (*PHYSICS, "gymnasium")


@dataclasses.dataclass(frozen=True)
class Scores:
    """Undiscounted returns and lengths of whole episodes, one entry per episode."""

    returns: np.ndarray  # [N]
    lengths: np.ndarray  # [N] control steps
    success: np.ndarray | None = None  # [N] 1 where the goal was reached; None of tasks without one

    @property
    def standard_error(self) -> float:
        """Standard error of the mean return; NaN of a single episode."""
        n = len(self.returns)
        return float(self.returns.std(ddof=1) / math.sqrt(n)) if n > 1 else math.nan


def check_request(engine: str, episodes: int) -> None:
    """Check what can be checked before a policy is read or an environment made.

    Raises:
      UsageError: the engine is unknown, or episodes is not a positive whole number.
    """
    if engine not in ENGINES:
        raise unknown_name("engine", str(engine), ENGINES)
    check_episodes(episodes)


def check_episodes(episodes: int) -> None:
    """Check that so many episodes side by side can be: their keys and their totals fit somewhere.

    Raises:
      UsageError: episodes is not a positive whole number, or more than memory holds.
    """
    check_memory({"episodes": 24 * whole_number("episodes", episodes, at_least=1)})


def score_each(
    policies: Policy,
    task: Task,
    engine: str,
    episodes: int,
    keys: Sequence[jax.Array],
    deterministic: bool = False,
    numbers: Mapping[str, np.ndarray] | None = None,
) -> list[Scores]:
    """Run the policies of several trainings for some episodes of their own task, side by side.

    Args:
      policies: their leaves [R, ...].
      task: what they learned last, as `RunConfig.task_at` says of their checkpoint's iteration.
      engine: "native", "mjx", "warp" or "gymnasium", which runs them one after the other.
      episodes: how many, of each policy.
      keys: R PRNG keys of the initial states and the actions.
      deterministic: take the likeliest option and action instead of sampling.
      numbers: what of the task is each policy's own, [R] by keyword (`envs.numbers`).

    Returns:
      R scores, in order.

    Raises:
      UsageError: the engine is unknown or does not have the task, episodes < 1, or the policies do
        not fit the task.
    """
    check_request(engine, episodes)
    numbers = numbers or {}
    if engine == "gymnasium":
        own = [task | {name: float(x[i]) for name, x in numbers.items()} for i in range(len(keys))]
        recorded = [
            run_in_gymnasium(policies.of(i), own[i], key, episodes, deterministic=deterministic)
            for i, key in enumerate(keys)
        ]
        return [Scores(np.asarray(x.returns), np.asarray(x.lengths)) for x in recorded]
    env = task_env(task, engine)
    check_fit(policies.of(0), env)
    returns, lengths, success = jax.device_get(
        _totals(policies, numbers, env, jnp.stack(keys), episodes, deterministic)
    )
    known = [None] * len(keys) if success is None else success
    return [Scores(*of_one) for of_one in zip(returns, lengths, known, strict=True)]


def task_env(task: Task, engine: PhysicsChoice) -> Env:
    """Return a task in an engine of JAX; the same object for the same task."""
    return _env(json.dumps(task, sort_keys=True), engine)


def check_fit(policy: Policy, env: Env) -> None:
    """Hold a policy against a task.

    Raises:
      UsageError: their observations or actions differ in kind or size.
    """
    own, task = policy.spec, spec_of(env)
    for does, mine, its in (
        ("observes", own.observation, task.observation),
        ("acts by", own.action, task.action),
    ):
        if str(mine) != str(its):
            raise UsageError(f"The policy {does} {mine}; the task has {its}.")


# Compiled apart from `run_episodes`: the compiler then leaves out what is recorded step by step.
@functools.partial(jax.jit, static_argnames=("env", "episodes", "deterministic"))
def _totals(
    policies: Policy,
    numbers: Mapping[str, jax.Array],
    env: Env,
    keys: jax.Array,
    episodes: int,
    deterministic: bool,
) -> tuple[jax.Array, jax.Array, jax.Array | None]:
    def of_one(number: jax.Array, key: jax.Array):
        policy = policies.of(number)
        own = {name: x[number] for name, x in numbers.items()}
        how = {"deterministic": deterministic, "numbers": own}
        recorded = run_episodes(policy, env, key, episodes, **how)
        return recorded.returns, recorded.lengths, recorded.success

    return jax.vmap(of_one)(jnp.arange(len(keys)), keys)


@functools.lru_cache(maxsize=1)
def _env(task: str, engine: PhysicsChoice) -> Env:
    """Make a run's task once: programs are compiled anew for every new environment."""
    return make_env(**json.loads(task), physics=engine)
