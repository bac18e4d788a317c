"""A Gaussian squashed by tanh, the action policy of soft actor-critic (Haarnoja et al. 2018)."""

from typing import Any

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.networks.mlp import MLP, orthogonal

LOG_STD = (-20.0, 2.0)  # within which log_std stays, as in the authors' code


class TanhGaussian(distrax.Transformed):
    """tanh(Normal(mean, std)), stretched over a range.

    Args:
      mean: [..., A], of the Gaussian.
      std: [..., A], of the Gaussian.
      low: the least action, [A] or a number.
      high: the greatest action.
    """

    def __init__(self, mean: jax.Array, std: jax.Array, low: Any = -1.0, high: Any = 1.0):
        middle, half = (jnp.asarray(x, jnp.float32) for x in ((low + high) / 2, (high - low) / 2))
        gaussian: Any = distrax.MultivariateNormalDiag(mean, std)
        stretch = distrax.ScalarAffine(shift=middle, scale=half)
        inner: Any = distrax.Chain([stretch, distrax.Tanh()])
        super().__init__(gaussian, distrax.Block(inner, 1))
        self.half = half

    def mode(self) -> jax.Array:
        """Return where the Gaussian's mean goes [..., A], which is the median of every entry."""
        gaussian: Any = self.distribution
        return jnp.asarray(self.bijector.forward(gaussian.mode()))

    def mode_and_log_prob(self) -> tuple[jax.Array, jax.Array]:
        """Return `mode` [..., A] and its log-probability (density) [...]."""
        gaussian: Any = self.distribution
        stretch: Any = self.bijector
        action, log_slope = stretch.forward_and_log_det(gaussian.mode())
        return action, gaussian.log_prob(gaussian.mode()) - log_slope

    def mean(self) -> jax.Array:
        """Return the median [..., A]: the mean has no closed form."""
        return self.mode()

    def stddev(self) -> jax.Array:
        """Return the standard deviation [..., A] to first order: the Gaussian's, times the slope.

        The slope is that of tanh at the Gaussian's mean.
        """
        gaussian: Any = self.distribution
        small = jnp.exp(-2.0 * jnp.abs(gaussian.mean()))
        slope = 4.0 * small / jnp.square(1.0 + small)  # 1 - tanh^2, exact where tanh is all but 1
        return self.half * slope * gaussian.stddev()


class SquashedHead(nn.Module):
    """The mean and the standard deviation of a Gaussian, both a function of state and option.

    Attributes:
      size: A.
      sizes: widths of the body.
      activation: a name of `mlp.ACTIVATIONS`.
    """

    size: int
    sizes: tuple[int, ...] = (256, 256)
    activation: str = "relu"

    @nn.compact
    def __call__(self, obs: jax.Array, *option: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Map `MLP`'s arguments to the mean and the standard deviation, [..., A] each."""
        features = MLP(self.sizes, self.activation, name="body")(obs, *option)
        head = nn.Dense(2 * self.size, kernel_init=orthogonal(0.01), name="gaussian")
        mean, log_std = jnp.split(head(features), 2, axis=-1)
        return mean, jnp.exp(jnp.clip(log_std, *LOG_STD))
