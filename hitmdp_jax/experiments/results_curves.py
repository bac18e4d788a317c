"""One page of all published curves, seeds and profiles; everything it needs is in it."""

import functools
from collections.abc import Mapping
from pathlib import Path

from hitmdp_jax.experiments.results import Cell, read, read_curve
from hitmdp_jax.experiments.results_page import Suite
from hitmdp_jax.experiments.statistics import bootstrap_interval, interquartile_mean
from hitmdp_jax.experiments.sweeps import by_setting
from hitmdp_jax.figures import scores
from hitmdp_jax.figures.style import styles
from hitmdp_jax.report.interactive import chart, learning_curves
from hitmdp_jax.report.page import Parts, drawing, page, preformatted, text


def curves_page(suites: Mapping[str, Suite], results: Path) -> str:
    """Return the page [HTML].

    Args:
      suites: name -> table.
      results: the folder of the published cells.
    """
    arms = {task: {} for suite in suites.values() for task in suite.tasks}
    for suite in suites.values():
        for task in suite.tasks:
            arms[task] |= dict.fromkeys(suite.arms)
    sections = {}
    for task, names in arms.items():
        cells = {name: cell for name in names if (cell := read(results / task / name))}
        if cells:
            sections[task] = functools.partial(_task, cells, results / task)
    return page("Published results", "every seed of every run in results/", sections)


def _task(cells: Mapping[str, Cell], folder: Path) -> Parts:
    curves, switches, returns, algorithms = {}, {}, {}, {}
    for arm, cell in cells.items():
        drawn = read_curve(folder / arm, cell.config.switch_at)
        for setting, own in by_setting(cell.config, cell.seeds | drawn).items():
            name = f"{arm}, {setting}" if setting else arm
            curves[name], switches[name] = own, cell.config.switch_at
            returns[name], algorithms[name] = own["last_100k_steps"], cell.config.algo["name"]
    looks = styles(algorithms)
    yield chart(learning_curves(curves, looks, switches, window=1))
    middles = [interquartile_mean(x) for x in returns.values()]
    ends = [bootstrap_interval(interquartile_mean, x) for x in returns.values()]
    yield drawing(scores.intervals(looks, list(returns.values()), middles, ends), "Returns")
    yield text(
        "Above: the last 100k steps of every seed, the interquartile mean, and its 95% interval "
        "where there are five seeds or more."
    )
    yield drawing(scores.profiles(looks, list(returns.values())), "Performance profiles")
    yield preformatted("\n".join(cell.about["command"] for cell in cells.values()))
