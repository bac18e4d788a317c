"""The one summary of a run: what each of its trainings did, one number per column."""

import dataclasses
import math
from typing import Any

import numpy as np

from hitmdp_jax.interpret.returns import (
    final_returns,
    final_window,
    last_episodes,
    mean_return,
    median_speed,
    options_at_the_end,
)
from hitmdp_jax.interpret.statistics import interquartile_mean
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.metrics import Metrics, by_setting

EPISODES = 20  # over which the paper's curves are averaged (App. B), and those of an evaluation

Columns = dict[str, np.ndarray]  # by name, [R] each


@dataclasses.dataclass(frozen=True)
class Summary:
    """What the R trainings of a run did, and what else is known of the run."""

    config: RunConfig
    columns: Columns  # as `columns_of` and an evaluation gave them
    about: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def returns(self) -> np.ndarray:
        """Each training's final return [R], as `final_returns` gives it."""
        return self.columns["last_100k_steps"]

    @property
    def window(self) -> str:
        """The steps that the final returns are of, in words."""
        return final_window(self.env_steps, self.config.switch_at)

    @property
    def env_steps(self) -> int:
        """Environment steps of each training."""
        return int(self.columns["env_steps"].max())

    @property
    def iqm(self) -> float:
        """The interquartile mean of the final returns."""
        return float(interquartile_mean(self.returns))

    @property
    def swept(self) -> str:
        """The first of what the run swept, or nothing."""
        return next(iter(self.config.sweep or {}), "")

    @property
    def setting(self) -> int:
        """The number of the first training's setting, among those of a sweep."""
        return int(self.columns.get("setting", [0])[0])

    @property
    def num_options(self) -> int:
        """K, or 1 of an algorithm without options."""
        return int(self.config.algo.get("num_options", 1))

    def by_setting(self) -> dict[str, "Summary"]:
        """Return a summary of each setting that the run swept, by name: their seeds alone compare.

        A run that sweeps nothing has one, whose name is empty.
        """
        each = by_setting(self.config, self.columns)
        return {name: dataclasses.replace(self, columns=dict(x)) for name, x in each.items()}


def summarize(config: RunConfig, metrics: Metrics) -> Summary:
    """Return the summary of a run; args as `columns_of`."""
    return Summary(config, columns_of(config, metrics))


def columns_of(config: RunConfig, metrics: Metrics) -> Columns:
    """Return the summary of each training of a run; returns are those of the training policy.

    Args:
      config: the run's settings.
      metrics: as `read_metrics` gives them.
    """
    switch_at = config.switch_at
    names = config.trainings[0].columns
    columns = {name: np.array([t.columns[name] for t in config.trainings]) for name in names}
    columns["env_steps"] = metrics["env_steps"][:, -1]
    columns["last_20_episodes"] = last_episodes(metrics, EPISODES, switch_at or 0)
    columns["last_100k_steps"] = final_returns(metrics, switch_at)
    if switch_at is not None:
        first = metrics["env_steps"][0] <= switch_at
        columns["first_task"] = final_returns({k: x[:, first] for k, x in metrics.items()}, None)
        # The area under the curve after the switch, in units of a return.
        columns["whole_second_task"] = mean_return(metrics, ~first)
    if "success" in metrics:
        columns["success"] = final_returns(metrics, switch_at, of="success")
    if options := options_at_the_end(metrics, switch_at):
        columns["options_used"], columns["main_option_duration"] = options
    if "steps_per_second" in metrics:
        columns["steps_per_second"] = np.full(len(config.trainings), median_speed(metrics))
    return columns


def rank(config: RunConfig, metrics: Metrics) -> dict[str, Summary]:
    """Return a sweep's settings by name, the one with the highest interquartile mean first.

    Those in which a seed has no return come last. Args are those of `columns_of`.
    """
    settings = summarize(config, metrics).by_setting()
    worth = {name: math.inf if math.isnan(x.iqm) else -x.iqm for name, x in settings.items()}
    return {name: settings[name] for name in sorted(settings, key=worth.__getitem__)}
