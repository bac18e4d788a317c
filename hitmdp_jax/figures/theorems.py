"""Theorem 3.3 and Proposition 3.5 on random option frameworks, computed (docs/theory.md).

What is computed is exact up to rounding; call it where x64 is enabled.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

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
