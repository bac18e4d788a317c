"""The one summary of a finished run: a number for each training, and a table of several runs."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hitmdp_jax.interpret.returns import (
    INTERVAL,
    failed,
    final_returns,
    final_window,
    last_episodes,
    mean_return,
    median_speed,
    one_window,
    options_at_the_end,
)
from hitmdp_jax.interpret.statistics import (
    against,
    interquartile_mean,
    number_text,
    rounding,
    with_interval,
)
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.metrics import Metrics, by_setting
from hitmdp_jax.training.sweep import PREFIX

EPISODES = 20  # over which the paper's curves are averaged (App. B), and those of an evaluation
CHOICES = ("own_choices", "uniform_choices", "best_option", "worst_option")

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
    """Return what is told of each training of a run; returns are those of the training policy.

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


def sweep_table(settings: Mapping[str, Summary]) -> list[list[str]]:
    """Return a sweep's settings as rows of text: each one's number and values, then as `table`."""
    swept = list(next(iter(settings.values())).config.sweep or {})
    index = [["setting", *(name.removeprefix(PREFIX) for name in swept)]]
    for run in settings.values():
        index.append([str(run.setting), *(f"{run.columns[name][0]:.4g}" for name in swept)])
    return table(settings, index=index, each=True)


def table(
    runs: Mapping[str, Summary],
    control: str | None = None,
    paper: Mapping[str, float] | None = None,
    index: Sequence[Sequence[str]] = (),
    each: bool = False,
) -> list[list[str]]:
    """Return runs, or settings of one, as rows of text, the header first.

    A column of which no run knows anything is left out.

    Args:
      runs: name -> summary.
      control: the run that the others are measured against.
      paper: name -> the return that the paper gives.
      index: what stands in the first columns, the header first; the names otherwise.
      each: tell the return of every seed too.
    """
    index = index or [[""], *([name] for name in runs)]
    every = [run.returns for run in runs.values()]
    spec = rounding(*every)
    columns = _of_returns(spec, one_window(run.window for run in runs.values()))
    if control is not None and control in runs:
        columns |= _of_control(runs[control].returns, control, spec)
    columns |= _of_policies(spec)
    told = {title: [tell(run) for run in runs.values()] for title, tell in columns.items()}
    if paper:
        told["paper"] = [number_text(paper.get(name, math.nan)) for name in runs]
    if each:
        of_each = rounding(*every, fewer=1)
        told["per seed"] = [" ".join(number_text(x, of_each) for x in y) for y in every]
    kept = {title: texts for title, texts in told.items() if set(texts) - {"-"}}
    rows = zip(*kept.values(), strict=True)
    return [[*index[0], *kept], *([*i, *row] for i, row in zip(index[1:], rows, strict=True))]


Tell = Callable[[Summary], str]


def _of_returns(spec: str, window: str) -> dict[str, Tell]:
    """Return what tells of the returns, by the title of its column."""

    def iqm(name: str) -> Tell:
        return _known(lambda x: with_interval(interquartile_mean, x, spec=spec), name)

    return {
        "seeds": lambda run: str(len(run.returns)),
        f"last {EPISODES} episodes": _known(lambda x: _spread(x, spec), "last_20_episodes"),
        f"IQM of {window} [{INTERVAL}]": iqm("last_100k_steps"),
        "first task, IQM": iqm("first_task"),
        "mean after the switch, IQM": iqm("whole_second_task"),
    }


def _of_control(control: np.ndarray, name: str, spec: str) -> dict[str, Tell]:
    return {
        f"minus {name} [{INTERVAL}]": lambda run: against(run.returns, control, spec)[0],
        "P(better)": lambda run: against(run.returns, control, spec)[1],
    }


def _of_policies(spec: str) -> dict[str, Tell]:
    return {
        "failed": lambda run: f"{failed(run.returns)}/{len(run.returns)}",
        "success": _known(lambda x: _spread(x, ".2f"), "success"),
        "deterministic": _known(lambda x: _spread(x, spec), "evaluation"),
        "options, duration": _known(_options, "options_used", "main_option_duration"),
        "choices": _known(_choices, *CHOICES),
        "own minus uniform": _known(_gain, *CHOICES[:2]),
        "steps/s": _known(lambda x: number_text(x.sum(), ".0f"), "steps_per_second"),
        "parameters": _known(lambda x: number_text(x[0], ".0f"), "parameters"),
    }


def _known(tell: Callable[..., str], *names: str) -> Tell:
    """Return what tells of some columns, and is "-" where a run does not have them."""

    def text(run: Summary) -> str:
        there = all(name in run.columns for name in names)
        return tell(*(run.columns[name] for name in names)) if there else "-"

    return text


def _spread(x: np.ndarray, spec: str) -> str:
    mean, std = (number_text(float(y), spec) for y in (np.mean(x), np.std(x)))
    return "-" if mean == "-" else f"{mean} ± {std}"


def _options(used: np.ndarray, duration: np.ndarray) -> str:
    return f"{(used >= 2).sum()}/{len(used)}, {number_text(float(np.median(duration)))}"


def _choices(*every: np.ndarray) -> str:
    spec = rounding(*every)
    return " / ".join(number_text(float(interquartile_mean(x)), spec) for x in every)


def _gain(own: np.ndarray, uniform: np.ndarray) -> str:
    return with_interval(interquartile_mean, own - uniform, spec=".2f")
