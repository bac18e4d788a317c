"""The feed-forward body that every policy and critic shares."""

from collections.abc import Callable

import flax.linen as nn
import jax

ACTIVATIONS: dict[str, Callable[[jax.Array], jax.Array]] = {"relu": nn.relu, "tanh": nn.tanh}
HIDDEN_GAIN = 2.0**0.5


def orthogonal(gain: float) -> nn.initializers.Initializer:
    """Return the orthogonal initializer (Saxe et al. 2014), safe to `vmap` over seeds.

    Batched QR factorisations can starve XLA's CPU thread pool and hang for ever on a machine of two
    cores, so a `vmap` over this initializer runs them one after another.
    """
    initialize = nn.initializers.orthogonal(gain)

    def init(key: jax.Array, shape: tuple[int, ...], dtype: object = None) -> jax.Array:
        return jax.custom_batching.sequential_vmap(lambda k: initialize(k, shape))(key)

    return init


class MLP(nn.Module):
    """Dense layers, each followed by the activation.

    Inputs are concatenated in effect but not in memory: the first layer is linear, so each input
    has its own kernel and inputs broadcast against one another. A body given states [B, 1, S] and
    option vectors [K, E] evaluates all K options and computes the states' part once.

    Attributes:
      sizes: width of each layer.
      activation: "relu" or "tanh".
      gain: of the orthogonal initial weights.
    """

    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    gain: float = HIDDEN_GAIN

    @nn.compact
    def __call__(self, *inputs: jax.Array) -> jax.Array:
        """Map inputs [..., I_i] to features [..., sizes[-1]]."""
        act = ACTIVATIONS[self.activation]
        init = orthogonal(self.gain)
        hidden = nn.Dense(self.sizes[0], kernel_init=init, name="input_0")(inputs[0])
        for i, extra in enumerate(inputs[1:], start=1):
            part = nn.Dense(self.sizes[0], use_bias=False, kernel_init=init, name=f"input_{i}")
            hidden = hidden + part(extra)
        x = act(hidden)
        for i, size in enumerate(self.sizes[1:], start=1):
            x = act(nn.Dense(size, kernel_init=init, name=f"hidden_{i}")(x))
        return x
