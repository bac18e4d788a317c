"""A sweep: hyperparameters that differ between the trainings of one program."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hitmdp_jax.agents import Agent
from hitmdp_jax.agents.base import hyperparameters_of
from hitmdp_jax.envs.keywords import parameters_of
from hitmdp_jax.envs.numbers import traced_of
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name

PREFIX = "algo."
TASK = "env."  # begins the names of the task's numbers
MOST_SETTINGS = 10_000
RANGES = ("uniform", "log_uniform")
FORM = "{algo.learning_rate:[1e-4,3e-4]} or {algo.learning_rate:{log_uniform:[1e-5,1e-3]}}"


@dataclasses.dataclass(frozen=True)
class Training:
    """One training of a run: a seed, under one setting of what the run sweeps."""

    seed: int
    setting: int  # the place of its setting among the sweep's, from 0
    swept: dict[str, float] = dataclasses.field(hash=False)  # what is swept -> its value

    @property
    def name(self) -> str:
        """What it is called in a sentence."""
        return f"seed {self.seed}" + (f" of {label(self.swept)}" if self.swept else "")

    @property
    def columns(self) -> dict[str, float]:
        """What tells it apart in a table: its seed and, in a sweep, its setting's values."""
        setting = {"setting": self.setting, **self.swept} if self.swept else {}
        return {"seed": self.seed, **setting}


def check_sweep(
    sweep: Any, samples: Any, agent: Agent, tasks: Sequence[Callable[..., Any]] = ()
) -> None:
    """Check what a run is asked to sweep.

    Args:
      sweep: `algo.` and a float hyperparameter, or `env.` and a number that the task lists in
        `traced`, -> a list of values, or a range such as {"log_uniform": [1e-5, 1e-3]}; or None.
      samples: how many settings are drawn at random; None takes every combination.
      agent: whose hyperparameters they are.
      tasks: the constructors of the tasks that are trained on.

    Raises:
      UsageError: saying what is wrong, and what would do.
    """
    if samples is not None and not sweep:
        raise UsageError(f"samples = {samples} draws from a sweep: give one, e.g. sweep={FORM}.")
    if sweep is None:
        return
    if not isinstance(sweep, Mapping) or not sweep or not all(isinstance(x, str) for x in sweep):
        raise UsageError(f"sweep = {sweep} must name what is swept, e.g. {FORM}.")
    traced = [PREFIX + name for name in agent.traced_values()]
    every = [PREFIX + field.name for field in hyperparameters_of(agent)]
    for task in tasks[:1]:
        traced += [TASK + name for name in traced_of(task, apart(sweep)[1])]
        every += [TASK + name for name in parameters_of(task)]
    for name, values in sweep.items():
        if name not in (*every, *traced):
            raise unknown_name("swept setting", str(name), traced)
        if name not in traced:
            why = "is no number that the task reads at each step"
            raise UsageError(
                f"{name} {why if name.startswith(TASK) else 'shapes the program'}, so one program "
                f"cannot sweep it: use -m. sweep takes {', '.join(traced)}."
            )
        if name.startswith(TASK) and len(tasks) > 1:
            raise UsageError(f"A transfer has two tasks: it sweeps {PREFIX} alone, not {name}.")
        _check_values(str(name), values, samples)
    settings = samples or math.prod(map(len, sweep.values()))
    if settings > MOST_SETTINGS:
        raise UsageError(
            f"The sweep has {settings:,} settings; at most {MOST_SETTINGS:,} are allowed."
        )


def _check_values(name: str, values: Any, samples: int | None) -> None:
    if isinstance(values, Mapping):
        kind, ends = next(iter(values.items())) if len(values) == 1 else (str(values), [])
        if kind not in RANGES:
            raise unknown_name(f"range of {name}", str(kind), RANGES)
        if not _are_numbers(ends) or len(ends) != 2 or not ends[0] < ends[1]:
            raise out_of_domain(f"sweep: {kind} of {name}", ends, "two ascending numbers")
        if kind == "log_uniform" and ends[0] <= 0:
            raise out_of_domain(f"sweep: {kind} of {name}", ends, "two ascending numbers above 0")
        if samples is None:
            raise UsageError(f"sweep: {name} is drawn from a range: say how often, samples=20.")
    elif not _are_numbers(values) or not values:
        raise out_of_domain(f"sweep: {name}", values, "a list of numbers or a range")
    elif len(set(values)) < len(values):
        raise UsageError(f"sweep: {name} = {list(values)} lists a value twice.")


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list | tuple) and all(
        isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in values
    )


def settings_of(
    sweep: Mapping[str, Any] | None, samples: int | None, seed: int
) -> list[dict[str, float]]:
    """Return the settings of a checked sweep: each combination, or so many drawn from `seed`."""
    if not sweep:
        return [{}]
    if samples is None:
        combinations = itertools.product(*sweep.values())
        return [dict(zip(sweep, map(float, values), strict=True)) for values in combinations]
    rng = np.random.default_rng(seed)
    return [{name: _drawn(values, rng) for name, values in sweep.items()} for _ in range(samples)]


def _drawn(values: Any, rng: np.random.Generator) -> float:
    if not isinstance(values, Mapping):
        return float(rng.choice(values))
    ((kind, (low, high)),) = values.items()
    if kind == "log_uniform":
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))


def apart(swept: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what is swept of the algorithm, and what of the task, each by its own name."""
    of_task = {name.removeprefix(TASK): x for name, x in swept.items() if name.startswith(TASK)}
    others = {name: x for name, x in swept.items() if not name.startswith(TASK)}
    return {name.removeprefix(PREFIX): x for name, x in others.items()}, of_task


def numbers_of(trainings: Sequence[Training]) -> dict[str, np.ndarray]:
    """Return the numbers of the task that are swept, float32 [N] of N trainings, by keyword."""
    each = [apart(training.swept)[1] for training in trainings]
    return {name: np.array([x[name] for x in each], np.float32) for name in each[0]}


def label(swept: Mapping[str, float]) -> str:
    """Return a setting as text: `learning_rate=0.0003, gamma=0.99`."""
    return ", ".join(f"{name.removeprefix(PREFIX)}={value:.4g}" for name, value in swept.items())
