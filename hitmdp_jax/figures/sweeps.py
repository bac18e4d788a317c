"""What a sweep's settings return: a heat map of two axes, a line of one, else a ranking."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hitmdp_jax.figures.curves import FAINT
from hitmdp_jax.figures.heat_maps import AMOUNT, UNKNOWN, annotate
from hitmdp_jax.figures.style import color, plain
from hitmdp_jax.interpret.returns import INTERVAL
from hitmdp_jax.interpret.statistics import (
    FEWEST,
    bootstrap_interval,
    interquartile_mean,
    rounding,
)
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.training.sweep import PREFIX


def sweep_figure(settings: Mapping[str, Summary], title: str, algorithm: str) -> Figure:
    """Plot the final returns of a sweep's settings, in the form that fits what was swept.

    Args:
      settings: as `rank` gives them.
      title: the figure's title.
      algorithm: whose colour it has, as settings name it.
    """
    config = next(iter(settings.values())).config
    axes = 0 if config.samples else len(config.sweep or {})
    draw = {1: along, 2: heat_map}.get(axes, ranking)
    return draw(settings, title, algorithm)


def ranking(settings: Mapping[str, Summary], title: str, algorithm: str) -> Figure:
    """Plot each setting, the best on top; args as `sweep_figure`."""
    figure = Figure(figsize=(7, 1.5 + 0.3 * len(settings)), layout="constrained")
    axes = figure.subplots()
    look: Any = {"color": color(algorithm)}
    for place, run in enumerate(settings.values()):
        axes.plot(run.returns, [place] * len(run.returns), "o", ms=4, alpha=FAINT, mew=0, **look)
        axes.plot(_interval(run), [place, place], lw=2, **look)
        axes.plot([run.iqm], [place], "|", ms=12, mew=2, **look)
    axes.set_yticks(range(len(settings)), [plain(name) for name in settings])
    axes.invert_yaxis()
    axes.set_xlabel(_label(settings))
    axes.set_title(plain(title))
    axes.grid(alpha=0.3)
    return figure


def along(settings: Mapping[str, Summary], title: str, algorithm: str) -> Figure:
    """Plot the settings of one axis in the order of its values; args as `sweep_figure`."""
    (name,), values, found = _by_value(settings)
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    look: Any = {"color": color(algorithm)}
    runs = [found[(x,)] for x in values[0]]
    axes.plot(range(len(runs)), [run.iqm for run in runs], "o-", **look)
    for place, run in enumerate(runs):
        axes.plot([place] * len(run.returns), run.returns, "o", ms=4, alpha=FAINT, mew=0, **look)
        axes.plot([place, place], _interval(run), lw=2, **look)
    axes.set_xlabel(name)
    _number(axes, "x", values[0])
    axes.set_ylabel(_label(settings).replace(": ", ":\n"))
    axes.set_title(plain(title))
    axes.grid(alpha=0.3)
    return figure


def heat_map(settings: Mapping[str, Summary], title: str, algorithm: str) -> Figure:
    """Plot the interquartile means of all pairs of two axes' values; args as `sweep_figure`."""
    names, (rows, columns), found = _by_value(settings)
    means = np.array([[found[row, column].iqm for column in columns] for row in rows])
    size = 2.4 + 0.8 * len(columns), 2.1 + 0.5 * len(rows)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(means, cmap=AMOUNT, aspect="auto")
    axes.set_facecolor(UNKNOWN)
    annotate(axes, image, rounding(means))
    axes.set(ylabel=names[0], xlabel=names[1])
    _number(axes, "y", rows)
    _number(axes, "x", columns)
    axes.set_title(plain(title))
    first = next(iter(settings.values()))
    figure.colorbar(image, label=f"return of {first.window},\nIQM of {len(first.returns)} seeds")
    return figure


def _interval(run: Summary) -> tuple[float, float]:
    return bootstrap_interval(interquartile_mean, run.returns)


def _label(settings: Mapping[str, Summary]) -> str:
    first = next(iter(settings.values()))
    seeds = len(first.returns)
    interval = f", {INTERVAL}" if seeds >= FEWEST else ""
    return f"return of {first.window}: each of {seeds} seeds, IQM{interval}"


def _number(axes: Axes, which: str, values: list[float]) -> None:
    """Name the places 0, 1, ... along an axis by their values."""
    getattr(axes, f"set_{which}ticks")(range(len(values)), [f"{x:g}" for x in values])


def _by_value(
    settings: Mapping[str, Summary],
) -> tuple[list[str], list[list[float]], dict[tuple[float, ...], Summary]]:
    """Return the axes' names, the values of each in order, and the settings by their values."""
    config = next(iter(settings.values())).config
    swept = list(config.sweep or {})
    found = {
        tuple(config.settings[run.setting][name] for name in swept): run
        for run in settings.values()
    }
    values = [sorted(set(axis)) for axis in zip(*found, strict=True)]
    return [plain(name.removeprefix(PREFIX)) for name in swept], values, found
