"""The feed-forward body that every policy and critic shares."""

from collections.abc import Callable

import flax.linen as nn
import jax
import jax.numpy as jnp

ACTIVATIONS: dict[str, Callable[[jax.Array], jax.Array]] = {
    "relu": nn.relu,
    "tanh": nn.tanh,
    "elu": nn.elu,
    "swish": nn.swish,
    "gelu": nn.gelu,  # by its tanh approximation
}
HIDDEN_GAIN = 2.0**0.5


def orthogonal(gain: float) -> nn.initializers.Initializer:
    """Return the orthogonal initializer (Saxe et al. 2014), safe to `vmap` over seeds.

    Batched QR factorisations can starve XLA's CPU thread pool and hang for ever on a machine of two
    cores, so a `vmap` over this initializer runs them one after another.
    """
    initialize = nn.initializers.orthogonal(gain)

    def init(key: jax.Array, shape: tuple[int, ...], dtype: object = None) -> jax.Array:
        one = jax.custom_batching.sequential_vmap(lambda k: initialize(k, shape, jnp.float32))
        return one(key)

    return init


class MLP(nn.Module):
    """Dense layers, each followed by the activation, of a state and the vector of an option.

    The two are concatenated in effect but not in memory: the first layer is linear, so each has its
    own kernel. The options' part is computed once an option, not once a sample, and states and
    options broadcast: states [B, 1, S] with options [K] evaluate all K options in each state.

    Attributes:
      sizes: width of each layer.
      activation: a name of `ACTIVATIONS`.
      gain: of the orthogonal initial weights.
      layer_norm: whether each layer is normalised before its activation (Ba et al. 2016).
    """

    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    gain: float = HIDDEN_GAIN
    layer_norm: bool = False

    @nn.compact
    def __call__(
        self, obs: jax.Array, *option: jax.Array, action: jax.Array | None = None
    ) -> jax.Array:
        """Map states to features.

        Args:
          obs: [..., S].
          *option: the vectors [K, E] of all options and which of them [...] each state goes with;
            nothing for a body of states alone.
          action: [..., A], of a body of states and actions; it broadcasts as options do.

        Returns:
          [..., sizes[-1]].
        """
        act = ACTIVATIONS[self.activation]
        init = orthogonal(self.gain)
        hidden = nn.Dense(self.sizes[0], kernel_init=init, name="input_0")(obs)
        if option:
            vectors, index = option
            part = nn.Dense(self.sizes[0], use_bias=False, kernel_init=init, name="input_1")
            hidden = hidden + select(part(vectors), index)
        if action is not None:
            part = nn.Dense(self.sizes[0], use_bias=False, kernel_init=init, name="input_action")
            hidden = hidden + part(action)
        x = act(self._normalized(hidden, 0))
        for i, size in enumerate(self.sizes[1:], start=1):
            hidden = nn.Dense(size, kernel_init=init, name=f"hidden_{i}")(x)
            x = act(self._normalized(hidden, i))
        return x

    def _normalized(self, x: jax.Array, layer: int) -> jax.Array:
        return nn.LayerNorm(name=f"norm_{layer}")(x) if self.layer_norm else x


def select(rows: jax.Array, index: jax.Array) -> jax.Array:
    """Return rows [K, E] by index [...]: [..., E]. A product, whose gradient is no scatter."""
    return jax.nn.one_hot(index, len(rows), dtype=rows.dtype) @ rows
