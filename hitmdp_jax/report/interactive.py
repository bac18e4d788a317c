"""The two charts in which a reader gains from pointing; Plotly draws them.

Among learning curves pointing tells which of many seeds a line is, and a part of them can be looked
at closely. In the explorer a reader picks the dimension of an embedding that is shifted. Every
other figure is the same on the page and on paper, and is drawn once, by Matplotlib (`figures/`).
"""

import html
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup

from hitmdp_jax.figures.curves import WINDOW, smooth
from hitmdp_jax.figures.embeddings import embedded, limit_of_changes
from hitmdp_jax.figures.style import Style, shades
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import strongest
from hitmdp_jax.report.page import packed, templates

POINTS = 400  # of a curve
PARTS = 1000  # of a chart's height, which is fewer pixels: as finely as this a curve is told


def learning_curves(
    runs: Mapping[str, Mapping[str, np.ndarray]],
    looks: Mapping[str, Style],
    switches: Mapping[str, int | None],
    window: int = WINDOW,
) -> go.Figure:
    """Draw the return of every seed, thin, and the mean over seeds.

    Args:
      runs: name -> metrics as `read_metrics` gives them.
      looks: name -> how its lines look.
      switches: name -> environment steps after which a transfer's second task began, or None.
      window: points over which a curve is smoothed.
    """
    shown = go.Figure()
    shown.update_layout(
        template="plotly_white",
        height=420,
        margin={"l": 60, "r": 20, "t": 20, "b": 50},
        font={"family": "system-ui, sans-serif", "size": 13},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0},
        hoverlabel={"namelength": -1},
        xaxis_title="environment steps",
        yaxis_title="episode return",
    )
    for name, metrics in runs.items():
        _add_curves(shown, name, metrics, looks[name].plotly, switches[name], window)
    for switch_at in set(switches.values()) - {None}:
        shown.add_vline(switch_at, line_dash="dash", annotation_text="second task")
    return shown


def _add_curves(
    shown: go.Figure,
    name: str,
    metrics: Mapping[str, np.ndarray],
    line: dict[str, Any],
    switch_at: int | None,
    window: int,
) -> None:
    chosen = np.unique(np.linspace(0, metrics["env_steps"].shape[1] - 1, POINTS).astype(int))
    steps = metrics["env_steps"][0, chosen]
    values = smooth(metrics["episode_return"], metrics["env_steps"][0], switch_at, window)
    values = values[:, chosen].astype(np.float32)
    several = len(values) > 1
    for seed, curve in zip(metrics["seed"][:, 0].astype(int), values, strict=True):
        shown.add_scatter(
            x=steps,
            y=curve,
            name=f"{name}, seed {seed}",
            line=line | {"width": 1},
            opacity=0.5 if several else 1.0,
            showlegend=not several,
        )
    if several:
        # Where a seed has no return yet, as after a switch, the mean has a gap.
        mean, thick = values.mean(axis=0), line | {"width": 3}
        shown.add_scatter(x=steps, y=mean, name=f"{name}, mean", line=thick)


def chart(shown: go.Figure, name: str) -> Markup:
    """Return a figure as a part of the page; whatever its names hold, they are shown as text.

    Args:
      shown: what is drawn.
      name: what it is called where it cannot be seen.
    """
    figure = json.loads(str(go.Figure(as_text(shown.to_plotly_json())).to_json()))
    del figure["layout"]["template"]["data"]  # the looks of kinds of charts that are not here
    curves = cast("Sequence[Any]", shown.data)
    unit = unit_of([curve.y for curve in curves])
    for told, curve in zip(figure["data"], curves, strict=True):
        told |= {"x": differences(curve.x, 1), "y": differences(curve.y, unit)}
    code = packed(json.dumps(figure | {"unit": unit}, separators=(",", ":")))
    return Markup(templates.get_template("chart.html").render(packed=code, name=name))


def unit_of(curves: Sequence[np.ndarray]) -> float:
    """Return the unit in which curves are told: 1, 2 or 5 of a decimal, a 1000th of their reach."""
    every = np.concatenate([*curves, [np.nan]])
    known = every[np.isfinite(every)]
    reach = float(np.ptp(known) or np.abs(known).max()) if known.size else 0.0
    finest = (reach or 1.0) / PARTS
    decimal = 10.0 ** math.floor(math.log10(finest))
    return decimal * max(digit for digit in (1, 2, 5) if digit * decimal <= finest)


def differences(curve: np.ndarray, unit: float) -> list[int | None]:
    """Return the first point of a curve [n], then what each adds to the known one before it.

    Args:
      curve: the points; one that is not known is None.
      unit: of the whole numbers that are returned.
    """
    whole = np.round(np.asarray(curve, float) / unit)
    known = np.isfinite(whole)
    added = iter(np.diff(whole[known], prepend=0.0).astype(int).tolist())
    return [next(added) if there else None for there in known]


def as_text(part: Any, name: str = "") -> Any:
    """Return a part of a figure with its texts escaped: Plotly reads HTML in all of them.

    Args:
      part: a dictionary, a sequence or a value of Plotly's JSON.
      name: what it is called there. Templates, of hovering or of cells, are our own.
    """
    if isinstance(part, str):
        return part if name.endswith("template") else html.escape(part, quote=False)
    if isinstance(part, dict):
        return {key: as_text(value, key) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [as_text(value, name) for value in part]
    return part


def explorer(analysis: OptionAnalysis) -> Markup:
    """Return the part in which a reader shifts a dimension and sees the actuators move.

    Raises:
      UsageError: the agent's options are no embeddings.
    """
    _, found = embedded(analysis)
    colors = shades(len(analysis.spec.action.names))
    limit = limit_of_changes(found)
    digits = 4 - math.floor(math.log10(limit))  # that a figure can show
    data: dict[str, Any] = {
        "shifts": found.shifts.round(2).tolist(),
        "moved": found.moved.astype(float).round(digits).tolist(),
        "limit": limit,
        "order": strongest(np.abs(found.slopes).max(axis=0)).tolist(),
        "actuators": as_text(analysis.spec.action.names),
        "lines": [Style(color, i % 3).plotly for i, color in enumerate(colors)],
        "first": int(analysis.by_usage[0]),
        "quantity": found.quantity,
    }
    options = [f"option {k}" for k in range(analysis.num_options)]
    template = templates.get_template("explorer.html")
    return Markup(template.render(data=data, options=options, choices=found.choices))
