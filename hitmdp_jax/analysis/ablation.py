"""What the arms of a study tell: returns against the control's, and what their options do."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hitmdp_jax.analysis.comparison import FINAL_STEPS, final_returns
from hitmdp_jax.analysis.figures import read_metrics
from hitmdp_jax.analysis.statistics import (
    against,
    interquartile_mean,
    number,
    rounding,
    with_interval,
)
from hitmdp_jax.learning.options import mean_duration

USED = 0.05  # of the steps: an option with fewer is not counted as used


@dataclasses.dataclass(frozen=True)
class Arm:
    """One arm of a study. Everything is of the last `FINAL_STEPS` steps of each seed."""

    name: str
    final_returns: np.ndarray  # [S] undiscounted, of the training policy
    control: np.ndarray  # [S'] those of the control
    used: np.ndarray  # [S] options with more than `USED` of the steps; NaN without options
    duration: np.ndarray  # [S] mean duration of the option used most, steps; NaN without options
    minutes: float

    @property
    def failed(self) -> int:
        """Return how many seeds end below half of the median (above twice it, if negative)."""
        median = np.median(self.final_returns)
        return int((self.final_returns < median - 0.5 * abs(median)).sum())


def measure(run_dirs: Mapping[str, Path], control: str) -> list[Arm]:
    """Summarise finished arms.

    Args:
      run_dirs: arm -> its run's folder.
      control: the arm that the others are measured against.
    """
    runs = {name: read_metrics(folder) for name, folder in run_dirs.items()}
    returns = {name: final_returns(metrics) for name, metrics in runs.items()}
    return [
        Arm(
            name, returns[name], returns[control], *options_at_the_end(metrics), minutes_of(metrics)
        )
        for name, metrics in runs.items()
    ]


def options_at_the_end(metrics: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return how many options each seed uses, and how long its main one lasts."""
    num_options = sum(name.startswith("option_steps_") for name in metrics)
    if not num_options:
        unknown = np.full(len(metrics["env_steps"]), np.nan)
        return unknown, unknown
    last = metrics["env_steps"][0] > metrics["env_steps"][0, -1] - FINAL_STEPS
    steps, activations = (
        np.stack([np.nansum(metrics[f"{name}_{k}"][:, last], axis=1) for k in range(num_options)])
        for name in ("option_steps", "option_activations")
    )
    main = steps.argmax(axis=0)[None]
    duration = np.take_along_axis(mean_duration(steps, activations), main, axis=0)[0]
    return (steps > USED * steps.sum(axis=0)).sum(axis=0).astype(float), duration


def minutes_of(metrics: Mapping[str, np.ndarray]) -> float:
    """Return how long a run took, by its median speed."""
    return float(metrics["env_steps"].max() / np.median(metrics["steps_per_second"][0]) / 60)


def table(arms: Sequence[Arm]) -> list[list[str]]:
    """Return the arms as rows of text, the header first."""
    rows = [
        [
            "arm", "IQM [95% interval]", "minus control [95% interval]", "P(better)", "failed",
            "options used", "duration", "minutes", "per seed",
        ]
    ]  # fmt: skip
    returns = [arm.final_returns for arm in arms]
    spec, of_each = rounding(*returns), rounding(*returns, fewer=1)
    for arm in arms:
        x = arm.final_returns
        lasting = "-" if np.isnan(arm.used).all() else f"{(arm.used >= 2).sum()}/{len(x)} use 2+"
        rows.append(
            [
                arm.name,
                with_interval(interquartile_mean, x, spec=spec),
                *against(x, arm.control, spec),
                f"{arm.failed}/{len(x)}",
                lasting,
                number(float(np.median(arm.duration))),
                f"{arm.minutes:.0f}",
                " ".join(number(value, of_each) for value in x),
            ]
        )
    return rows
