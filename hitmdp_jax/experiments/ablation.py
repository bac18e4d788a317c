"""What the arms of a study tell: returns against the control's, and what their options do."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from hitmdp_jax.experiments.comparison import (
    INTERVAL,
    Metrics,
    final_reports,
    final_returns,
    final_window,
    median_speed,
    one_window,
)
from hitmdp_jax.experiments.statistics import (
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
    """One arm of a study. Everything but the minutes is of the final reports of each seed."""

    name: str
    window: str  # the steps of those reports, in words
    env_steps: int  # of each seed
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


def measure(
    runs: Mapping[str, Metrics], switches: Mapping[str, int | None], control: str
) -> list[Arm]:
    """Summarise finished arms.

    Args:
      runs: arm -> metrics of its seeds.
      switches: arm -> environment steps after which a transfer's second task began, or None.
      control: the arm that the others are measured against.
    """
    returns = {name: final_returns(metrics, switches[name]) for name, metrics in runs.items()}
    return [
        Arm(
            name,
            final_window(metrics, switches[name]),
            int(metrics["env_steps"].max()),
            returns[name],
            returns[control],
            *options_at_the_end(metrics, switches[name]),
            minutes_of(metrics),
        )
        for name, metrics in runs.items()
    ]


def options_at_the_end(metrics: Metrics, switch_at: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Return how many options each seed uses, and how long its main one lasts.

    Args are those of `final_reports`.
    """
    num_options = sum(name.startswith("option_steps_") for name in metrics)
    if not num_options:
        unknown = np.full(len(metrics["env_steps"]), np.nan)
        return unknown, unknown
    last = final_reports(metrics, switch_at)
    steps, activations = (
        np.stack([np.nansum(metrics[f"{name}_{k}"][:, last], axis=1) for k in range(num_options)])
        for name in ("option_steps", "option_activations")
    )
    main = steps.argmax(axis=0)[None]
    duration = np.take_along_axis(mean_duration(steps, activations), main, axis=0)[0]
    return (steps > USED * steps.sum(axis=0)).sum(axis=0).astype(float), duration


def minutes_of(metrics: Metrics) -> float:
    """Return how long a run took, by its median speed; NaN where none is known."""
    return float(metrics["env_steps"].max() / median_speed(metrics) / 60)


def table(arms: Sequence[Arm]) -> list[list[str]]:
    """Return the arms as rows of text, the header first."""
    rows = [
        [
            "arm", "seeds", f"IQM of {one_window(arm.window for arm in arms)} [{INTERVAL}]",
            f"minus control [{INTERVAL}]", "P(better)", "failed", "options used", "duration",
            "minutes", "per seed",
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
                str(len(x)),
                with_interval(interquartile_mean, x, spec=spec),
                *against(x, arm.control, spec),
                f"{arm.failed}/{len(x)}",
                lasting,
                number(float(np.median(arm.duration))),
                number(arm.minutes, ".0f"),
                " ".join(number(value, of_each) for value in x),
            ]
        )
    return rows
