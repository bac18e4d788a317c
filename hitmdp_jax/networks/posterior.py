"""q(o | where the option led): which option it was, told from what it changed."""

import flax.linen as nn
import jax

from hitmdp_jax.networks.mlp import MLP, orthogonal


class OptionPosterior(nn.Module):
    """A classifier of options by a change of the observation.

    Its logarithm is the reward of options that learn to lead to different places: the variational
    bound on the mutual information of the option and the change (Gregor et al. 2016, "Variational
    intrinsic control"; Eysenbach et al. 2019, "Diversity is all you need").

    Attributes:
      num_options: K.
      sizes: widths of the body.
      activation: a name of `mlp.ACTIVATIONS`.
    """

    num_options: int
    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"

    @nn.compact
    def __call__(self, change: jax.Array) -> jax.Array:
        """Map changes [..., O] to log q(o | change) [..., K]."""
        features = MLP(self.sizes, self.activation, name="body")(change)
        logits = nn.Dense(self.num_options, kernel_init=orthogonal(0.01), name="logits")(features)
        return jax.nn.log_softmax(logits)
