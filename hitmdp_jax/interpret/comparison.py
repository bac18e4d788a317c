"""A table of several runs, or of a sweep's settings: what their summaries tell, as rows of text."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hitmdp_jax.interpret.returns import INTERVAL, failed, one_window
from hitmdp_jax.interpret.statistics import (
    against,
    interquartile_mean,
    number_text,
    rounding,
    with_interval,
)
from hitmdp_jax.interpret.summary import EPISODES, Summary
from hitmdp_jax.training.sweep import PREFIX

CHOICES = ("own_choices", "uniform_choices", "best_option", "worst_option")
Tell = Callable[[Summary], str]


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


def _of_returns(spec: str, window: str) -> dict[str, Tell]:
    """Return the functions that write the cells about returns, by the title of the column."""

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
    """Return a function that writes a cell from some columns, "-" if a run lacks them."""

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
