"""How many options are used under each setting of a sweep (Figure 11)."""

import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.experiments.results import Columns
from hitmdp_jax.figures.style import shades
from hitmdp_jax.training.sweep import PREFIX


def counts(seeds: Columns, name: str, num_options: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of what is swept [V], and how many seeds use k options under each [V, K].

    Args:
      seeds: a cell's, `options_used` [R] among them.
      name: what is swept.
      num_options: K.
    """
    values = np.unique(seeds[name])
    each = np.arange(1, num_options + 1)
    used = [seeds["options_used"][seeds[name] == value] for value in values]
    return values, np.array([(x[:, None] == each).sum(axis=0) for x in used])


def figure(seeds: Columns, name: str, num_options: int) -> Figure:
    """Draw the histogram, a group of bars for each value; Args as `counts`."""
    values, found = counts(seeds, name, num_options)
    drawn = Figure(figsize=(6, 3.5), layout="constrained")
    axes = drawn.subplots()
    width = 0.8 / num_options
    for k, color in enumerate(shades(num_options)):
        places = np.arange(len(values)) + (k - (num_options - 1) / 2) * width
        label = f"{k + 1} option{'s' if k else ''}"
        bars = axes.bar(places, found[:, k], width, color=color, label=label)
        axes.bar_label(bars, fontsize=8)
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values])
    axes.set(xlabel=name.removeprefix(PREFIX), ylabel="seeds")
    axes.set_title("options with at least 5% of the last 100k steps")
    drawn.legend(loc="outside lower center", ncols=num_options)
    return drawn
