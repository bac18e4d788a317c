"""The report's figures: what a reader may point at, drawn by Plotly."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from hitmdp_jax.figures.curves import WINDOW, option_curves, smooth
from hitmdp_jax.figures.style import Style, option_color
from hitmdp_jax.interpret.interventions import Effects, Interventions
from hitmdp_jax.interpret.projection import Projection

POINTS = 400  # of a curve, and episodes' steps are shown whole
SCATTERED = 1500  # states of a scatter plot
DIVERGING, RISING = "RdBu_r", "Blues"


def figure(height: int = 360, **layout: Any) -> go.Figure:
    """Return an empty figure in the report's dress; it fills the width that it is given."""
    shown = go.Figure()
    shown.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 60, "r": 20, "t": 20, "b": 50},
        font={"family": "system-ui, sans-serif", "size": 13},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0},
        hoverlabel={"namelength": -1},
        **layout,
    )
    return shown


def learning_curves(
    runs: Mapping[str, Mapping[str, np.ndarray]],
    column: str,
    title: str,
    looks: Mapping[str, Style],
    switches: Mapping[str, int | None],
    window: int = WINDOW,
) -> go.Figure:
    """Draw a metric of every seed, thin, and the mean over seeds.

    Args:
      runs: name -> metrics as `read_metrics` gives them.
      column: which metric.
      title: what the vertical axis shows.
      looks: name -> how its lines look.
      switches: name -> environment steps after which a transfer's second task began, or None.
      window: points over which a curve is smoothed.
    """
    shown = figure(420, xaxis_title="environment steps", yaxis_title=title)
    for name, metrics in runs.items():
        line = looks[name].plotly
        chosen = np.unique(np.linspace(0, metrics["env_steps"].shape[1] - 1, POINTS).astype(int))
        steps, values = metrics["env_steps"][0, chosen], metrics[column]
        values = smooth(values, metrics["env_steps"][0], switches[name], window)[:, chosen]
        for seed, curve in zip(metrics["seed"][:, 0].astype(int), values, strict=True):
            shown.add_scatter(
                x=steps,
                y=curve.astype(np.float32),
                name=f"{name}, seed {seed}",
                line=line | {"width": 1},
                opacity=0.5 if len(values) > 1 else 1.0,
                showlegend=False,
            )
        if len(values) > 1:
            known = ~np.isnan(values).any(axis=0)
            mean = values[:, known].mean(axis=0).astype(np.float32)
            thick = line | {"width": 3}
            shown.add_scatter(x=steps[known], y=mean, name=f"{name}, mean", line=thick)
    for switch_at in set(switches.values()):
        mark_switch(shown, switch_at)
    return shown


def mark_switch(shown: go.Figure, switch_at: int | None) -> None:
    """Mark where a transfer's second task began, if there is one."""
    if switch_at is not None:
        shown.add_vline(switch_at, line_dash="dash", annotation_text="second task")


def training_options(
    metrics: Mapping[str, np.ndarray], place: int, switch_at: int | None = None
) -> tuple[go.Figure, go.Figure]:
    """Draw how one training's options shared the steps, and how long they lasted."""
    steps = metrics["env_steps"][0]
    shares, durations = option_curves(metrics, switch_at, place)
    usage = figure(300, xaxis_title="environment steps", yaxis_title="share of steps")
    lasting = figure(300, xaxis_title="environment steps", yaxis_title="mean duration (steps)")
    chosen = np.unique(np.linspace(0, len(steps) - 1, POINTS).astype(int))
    for k in range(len(shares)):
        style = {"x": steps[chosen], "name": f"option {k}"}
        line = {"color": option_color(k)}
        usage.add_scatter(y=shares[k, chosen], stackgroup="all", line=line | {"width": 0}, **style)
        lasting.add_scatter(y=durations[k, chosen], line=line, **style)
    for shown in (usage, lasting):
        mark_switch(shown, switch_at)
    usage.update_yaxes(range=[0, 1])
    lasting.update_yaxes(type="log")
    return usage, lasting


def strips(option: ArrayLike, alive: ArrayLike, number: int, dt: float | None) -> go.Figure:
    """Draw which option acts when: a row an episode, time to the right.

    Args:
      option: [T, N].
      alive: [T, N] bool, the step belongs to the episode.
      number: K.
      dt: seconds a step; None counts steps.
    """
    option, alive = np.asarray(option), np.asarray(alive, bool)
    longest = int(alive.sum(axis=0).max())
    option, alive = option[:longest], alive[:longest]
    unit, axis = ("step", "%{x}") if dt is None else ("seconds", "%{x:.2f} s")
    taken = np.where(alive, option, np.nan).astype(np.float32).T
    height = max(110 + 26 * len(taken), 80 + 16 * number)  # rows, and the colours beside them
    shown = figure(height, xaxis_title=unit, yaxis_title="episode")
    shown.add_heatmap(
        z=taken,
        x=np.arange(longest) * (dt or 1),
        y=np.arange(1, len(taken) + 1),
        zmin=-0.5,
        zmax=number - 0.5,
        colorscale=_steps_of_color(number),
        colorbar={"title": "option", "tickvals": list(range(number)), "thickness": 12},
        hovertemplate=axis + ": option %{z}<extra>episode %{y}</extra>",
        ygap=3,
    )
    shown.update_yaxes(dtick=1, autorange="reversed")
    return shown


def _steps_of_color(number: int) -> list[tuple[float, str]]:
    return [(end / number, option_color(k)) for k in range(number) for end in (k, k + 1)]


def matrix(
    values: ArrayLike,
    rows: Sequence[str],
    columns: Sequence[str],
    limit: float,
    *,
    axes: tuple[str, str] = ("", ""),
    signed: bool = False,
    written: str | None = ".2f",
) -> go.Figure:
    """Draw a matrix [R, C] as coloured cells.

    Args:
      values: the cells.
      rows: their names, R.
      columns: their names, C.
      limit: where the colours end; nothing is to fill them that is tiny.
      axes: what columns and rows are.
      signed: zero is the middle of the colours.
      written: how the numbers stand in the cells; None leaves them out.
    """
    shown = figure(90 + max(26 * len(rows), 120))
    shown.add_heatmap(
        z=np.asarray(values, np.float32),
        x=list(columns),
        y=list(rows),
        zmin=-limit if signed else 0.0,
        zmax=limit,
        colorscale=DIVERGING if signed else RISING,
        texttemplate=written and f"%{{z:{written}}}",
        colorbar={"thickness": 12},
        hovertemplate="%{y}, %{x}: %{z:.3f}<extra></extra>",
    )
    shown.update_yaxes(autorange="reversed", title=axes[1], type="category")
    shown.update_xaxes(title=axes[0], type="category")
    return shown


def returns_by_choice(found: Interventions, effect: Effects, number: int) -> go.Figure:
    """Draw the returns under each way of choosing options: every episode, mean, standard error."""
    shown = figure(90 + 32 * len(found.names), xaxis_title="return", showlegend=False)
    colors = ["#222222"] * (len(found.names) - number) + [option_color(k) for k in range(number)]
    for i, (name, color) in enumerate(zip(found.names, colors, strict=True)):
        shown.add_scatter(
            x=found.returns[i],
            y=[name] * len(found.returns[i]),
            mode="markers",
            marker={"symbol": "line-ns-open", "color": color, "size": 10},
            opacity=0.6,
            name=name,
        )
        shown.add_scatter(
            x=effect.mean[i : i + 1],
            y=[name],
            error_x={"array": np.nan_to_num(effect.error[i : i + 1]), "thickness": 2},
            mode="markers",
            marker={"color": color, "size": 10},
            name=f"{name}, mean",
        )
    shown.add_vline(float(effect.mean[0]), line_dash="dot")
    shown.update_yaxes(autorange="reversed", automargin=True)
    return shown


def scatter(projection: Projection, option: ArrayLike) -> go.Figure:
    """Draw the visited states in two dimensions, in the colour of the option that acts there."""
    option = np.asarray(option)
    chosen = np.unique(np.linspace(0, len(option) - 1, SCATTERED).astype(int))
    first, second = (f"{share:.0%} of the variance" for share in projection.explained[:2])
    shown = figure(420, xaxis_title=first, yaxis_title=second)
    for k in np.unique(option[chosen]):
        here = chosen[option[chosen] == k]
        x, y = projection.points[here].astype(np.float32).T
        marker = {"color": option_color(int(k)), "size": 4}
        shown.add_scatter(x=x, y=y, mode="markers", marker=marker, name=f"option {k}")
    return shown


def intervals(
    looks: Mapping[str, Style],
    scores: Sequence[np.ndarray],
    middles: ArrayLike,
    ends: ArrayLike,
) -> go.Figure:
    """Draw each run's interquartile mean with its interval, if known, and a point for every seed.

    Args:
      looks: name of a run -> how its points look.
      scores: the seeds' returns of each, [S].
      middles: the interquartile means [R].
      ends: their intervals [R, 2]; NaN where unknown.
    """
    shown = figure(110 + 40 * len(looks), xaxis_title="return", showlegend=False)
    for i, ((name, style), x) in enumerate(zip(looks.items(), scores, strict=True)):
        name = f"{name} (n = {len(x)})"
        middle, (low, high) = np.asarray(middles)[i], np.asarray(ends)[i]
        marker = {"symbol": "line-ns-open", "color": style.color, "size": 10}
        shown.add_scatter(x=x, y=[name] * len(x), mode="markers", marker=marker, name=name)
        error = {"type": "data", "symmetric": False}
        error |= {"array": [np.nan_to_num(high - middle)]}
        error |= {"arrayminus": [np.nan_to_num(middle - low)]}
        shown.add_scatter(
            x=[middle],
            y=[name],
            error_x=error,
            mode="markers",
            marker={"symbol": style.symbol, "color": style.color, "size": 11},
            name=f"{name}: interquartile mean",
        )
    shown.update_yaxes(autorange="reversed", automargin=True)
    return shown


def profiles(looks: Mapping[str, Style], scores: Sequence[np.ndarray]) -> go.Figure:
    """Draw the share of seeds above each return: performance profiles (Agarwal et al. 2021)."""
    shown = figure(360, xaxis_title="return", yaxis_title="share of seeds above")
    for (name, style), x in zip(looks.items(), scores, strict=True):
        x = np.sort(x[np.isfinite(x)])
        line = style.plotly | {"shape": "vh"}
        shown.add_scatter(x=x, y=1 - np.arange(len(x)) / max(len(x), 1), name=name, line=line)
    return shown
