"""Observations in units of their running mean and standard deviation."""

from typing import Any

import jax
import jax.numpy as jnp
from brax.training.acme import running_statistics
from brax.training.acme.running_statistics import NestedMeanStd, RunningStatisticsState
from brax.training.types import UInt64
from jax.typing import ArrayLike

from hitmdp_jax.precision import in_32_bits

OBSERVATION_CLIP = 10.0  # normalised observations lie within +-10 standard deviations
MIN_STD = 1e-4


def initial_statistics(observation_size: int) -> RunningStatisticsState:
    """Return the statistics of no observation: mean 0, standard deviation 1."""
    statistics = running_statistics.init_state(jnp.zeros(observation_size, jnp.float32))
    # Brax's Python numbers get the types they have in a checkpoint: the program is one for both.
    return jax.tree.map(lambda x: in_32_bits(jnp.asarray(x, jnp.asarray(x).dtype)), statistics)


def update_statistics(statistics: RunningStatisticsState, obs: jax.Array) -> RunningStatisticsState:
    """Take observations [..., O] into account.

    The standard deviation is at least 1e-4, the 1e-8 under the root of DAC's public code and of
    Stable-Baselines3's VecNormalize. Brax's own floor of 1e-6 is below the rounding of a mean of
    order 1 and made +-1.9 of observations that never change.
    """
    return in_32_bits(running_statistics.update(statistics, _as_floats(obs), std_min_value=MIN_STD))


def statistics_of(mean: jax.Array, std: jax.Array, count: ArrayLike) -> RunningStatisticsState:
    """Return the statistics of `count` [...] observations whose mean and std [..., O] are known."""
    seen = jnp.asarray(count, jnp.float32)
    halves = (x.astype(jnp.uint32) for x in jnp.divmod(seen, 2.0**32))
    return RunningStatisticsState(
        mean=mean,
        std=std,
        count=UInt64(*halves),  # pyright: ignore[reportCallIssue]
        summed_variance=jnp.square(std) * seen[..., None],
        std_eps=jnp.zeros_like(seen),  # pyright: ignore[reportArgumentType]
    )


def count_of(statistics: RunningStatisticsState) -> jax.Array:
    """Return how many observations the statistics are of, float32 [...]."""
    count: Any = statistics.count
    return jnp.float32(2.0**32) * count.hi.astype(jnp.float32) + count.lo.astype(jnp.float32)


def normalize(obs: ArrayLike, statistics: NestedMeanStd | None) -> jax.Array:
    """Return observations [..., O] in units of their running mean and standard deviation.

    Whole numbers and booleans are numbers like any other; Brax would hand them on as they are.
    Without statistics observations become floats and nothing else.
    """
    if statistics is None:
        return _as_floats(obs)
    return running_statistics.normalize(_as_floats(obs), statistics, max_abs_value=OBSERVATION_CLIP)


def _as_floats(obs: ArrayLike) -> jax.Array:
    return jnp.asarray(obs, jnp.float32)
