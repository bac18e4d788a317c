"""Theorem 3.3 and Proposition 3.5 on random option frameworks, computed and drawn (docs/theory.md).

What is computed is exact up to rounding; call it where x64 is enabled.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.figures.style import shades
from hitmdp_jax.theory.hit_mdp import hit_mdp, occupancy
from hitmdp_jax.theory.model import OptionModel, sample_option_model
from hitmdp_jax.theory.values import distances_to_fixed_point
from hitmdp_jax.theory.variance import (
    VarianceDecomposition,
    previous_option_belief,
    variance_decomposition,
)

NUM_STATES, NUM_OPTIONS, NUM_ACTIONS = 10, 4, 4
CONCENTRATION = 0.3  # sparse enough for options to differ
NUM_MODELS = 20
NUM_ITERATIONS = 200
GAMMAS = (0.5, 0.8, 0.9, 0.99)
GAMMA = 0.9  # of Proposition 3.5's models
TERMINATIONS = tuple(i / 20 for i in range(21))
SCATTERED = (0.0, 0.1, 1.0)  # the terminations whose states are drawn one by one


def sample_models(key: jax.Array) -> OptionModel:
    """Draw the models that both figures share, [models, ...]."""

    def sample(key: jax.Array) -> OptionModel:
        sizes = NUM_STATES, NUM_OPTIONS, NUM_ACTIONS
        return sample_option_model(key, *sizes, gamma=GAMMA, concentration=CONCENTRATION)

    return jax.jit(jax.vmap(sample))(jax.random.split(key, NUM_MODELS))


def contraction(models: OptionModel, gammas: Sequence[float] = GAMMAS) -> np.ndarray:
    """Return d_n / d_0, [gammas, models, NUM_ITERATIONS + 1], at most gamma^n (Theorem 3.3).

    d_n is the sup-norm distance from Q_A after n applications of T^H to Q = 0.

    Args:
      models: [models, ...], whose own gamma is not used.
      gammas: discount factors below 1.
    """

    def relative_distances(gamma: jax.Array, model: OptionModel) -> jax.Array:
        model = dataclasses.replace(model, gamma=gamma)
        distances = distances_to_fixed_point(model, NUM_ITERATIONS)
        return distances / distances[0]

    return _over_models(relative_distances, gammas, models)


def variances(
    models: OptionModel, terminations: Sequence[float] = TERMINATIONS, at_start: bool = False
) -> VarianceDecomposition:
    """Return the variances of Proposition 3.5, each [terminations, models, S].

    Args:
      models: [models, ...], whose own terminations are not used.
      terminations: each is the termination probability of every option in every state, in turn.
      at_start: take P(o_{t-1} | s) at t = 0 of episodes that start with o_{-1} = 0, so that one
        previous option occurs, instead of over the discounted visits from a uniform (s_0, o_{-1}).
    """
    uniform = jnp.full((NUM_STATES, NUM_OPTIONS), 1.0 / (NUM_STATES * NUM_OPTIONS))
    one_option = jnp.zeros_like(uniform).at[:, 0].set(1.0 / NUM_STATES)

    def decompose(termination: jax.Array, model: OptionModel) -> VarianceDecomposition:
        everywhere = jnp.full_like(model.termination, termination)
        hit = hit_mdp(dataclasses.replace(model, termination=everywhere))
        visits = one_option if at_start else occupancy(hit, uniform)
        return variance_decomposition(hit, previous_option_belief(visits))

    return _over_models(decompose, terminations, models)


def _over_models(function: Callable[..., Any], values: Sequence[float], models: OptionModel) -> Any:
    """Return function(value, model) for every value and model, leaves [values, models, ...]."""

    # Loops, since vmap can hang: JAX 0.10's batched solves on CPUs wait for threads of the pool
    # they run on, so that as many independent ones as there are threads wait for ever.
    def over_models(value: jax.Array) -> Any:
        return jax.lax.map(lambda model: function(value, model), models)

    return jax.device_get(jax.jit(lambda x: jax.lax.map(over_models, x))(jnp.array(values)))


def contraction_figure(distances: np.ndarray, gammas: Sequence[float] = GAMMAS) -> Figure:
    """Plot d_n / d_0 against n, below gamma^n (Theorem 3.3): median and range of the models.

    Args:
      distances: [gammas, models, n + 1], as `contraction` gives them.
      gammas: their discount factors.
    """
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    n, floor = np.arange(distances.shape[-1]), 1e-10  # rounding errors stay out of sight
    for gamma, color, curves in zip(gammas, shades(len(gammas)), distances, strict=True):
        bound = gamma**n
        axes.fill_between(n, curves.min(0), curves.max(0), color=color, alpha=0.25, lw=0)
        axes.plot(n, np.median(curves, axis=0), color=color)
        axes.plot(n, bound, color=color, ls="--")
        end = n[bound > floor][-1]
        beside = {"xytext": (4, 2), "textcoords": "offset points"}
        axes.annotate(f"$\\gamma = {gamma}$", (end, bound[end]), **beside)
    for style, label in (
        ("--", r"bound $\gamma^n$"),
        ("-", f"median and range, {distances.shape[1]} models"),
    ):
        axes.plot([], [], color="black", ls=style, label=label)
    axes.set(
        xlabel=r"applications $n$ of $\mathcal{T}^H$",
        ylabel=r"$\|Q^n - Q_A\|_\infty \;/\; \|Q^0 - Q_A\|_\infty$",
        title=r"Theorem 3.3: $\mathcal{T}^H$ contracts by $\gamma$",
        yscale="log",
        xlim=(0, n[-1]),
        ylim=(floor, 2.0),
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.68))
    return figure


def variance_figure(
    parts: VarianceDecomposition,
    at_start: VarianceDecomposition,
    terminations: Sequence[float] = TERMINATIONS,
) -> Figure:
    """Plot how returns scatter around V-bar against how they scatter around V (Proposition 3.5).

    Left, each point is a state of a model; on the diagonal V-bar tells no more than V. Right, the
    ratio of the two over all states, against the termination probability.

    Args:
      parts: [terminations, models, S], as `variances` gives them.
      at_start: the same where one previous option occurs, of any terminations.
      terminations: those of `parts`, `SCATTERED` among them.
    """
    around_v = r"$\mathbb{E}\,[(G_t - V[s_t])^2 \mid s_t]$"
    around_v_bar = r"$\mathbb{E}\,[(G_t - \bar V[s_t, o_{t-1}])^2 \mid s_t]$"
    figure = Figure(figsize=(10, 4.7), layout="constrained")
    points, ratios = figure.subplots(1, 2)
    limit = 1.05 * max(parts.total.max(), at_start.total.max())
    points.axline((0, 0), slope=1, color="black", lw=1)
    ratio = (parts.within / parts.total).reshape(len(terminations), -1)
    median = np.median(ratio, axis=1)
    ratios.fill_between(terminations, ratio.min(1), ratio.max(1), color="#bbbbbb", alpha=0.5, lw=0)
    ratios.plot(terminations, median, color="black", label="median and range of states")
    for termination, color, marker in zip(SCATTERED, shades(len(SCATTERED)), "o^s", strict=True):
        i = terminations.index(termination)
        style = {"color": color, "marker": marker, "lw": 0}
        label = rf"$\beta = {termination:g}$"
        points.scatter(parts.total[i], parts.within[i], s=12, alpha=0.7, label=label, **style)
        ratios.plot(termination, median[i], ms=7, clip_on=False, **style)
    style = {"color": "#777777", "marker": "x", "lw": 0.7, "zorder": 1}
    points.scatter(at_start.total, at_start.within, s=14, label="one $o_{t-1}$ occurs", **style)
    points.set(
        xlabel=around_v,
        ylabel=around_v_bar,
        title=r"Proposition 3.5, corrected: $\bar V$ errs no more than $V$",
        xlim=(0, limit),
        ylim=(0, limit),
        aspect="equal",
    )
    ratios.set(
        xlabel=r"termination probability $\beta$",
        ylabel=rf"{around_v_bar} $/$ {around_v}",
        title="equal where every option terminates",
        ylim=(0, 1.05),
    )
    points.locator_params(nbins=4)
    for axes in (points, ratios):
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left" if axes is points else "lower right")
    return figure
