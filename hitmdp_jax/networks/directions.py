"""The directions by which options are told apart: one unit vector per option."""

import flax.linen as nn
import jax
import jax.numpy as jnp

EPSILON = 1e-12  # keeps the only row of a single option, which is 0, from being divided by 0


class OptionDirections(nn.Module):
    """One learned direction per option, in the space of changes of the observation.

    They are the logits of q(o | where the option led), whose logarithm is the reward of options
    that learn to lead to different places: the variational bound on the mutual information of the
    option and the change (Gregor et al. 2016, "Variational intrinsic control"; Eysenbach et al.
    2019, "Diversity is all you need"). A deep classifier can tell options apart by tiny changes,
    and pays nothing for larger ones. A logit that is linear in the change, with a fixed slope, pays
    for going far (as in Park et al. 2022, "Lipschitz-constrained unsupervised skill discovery").

    Attributes:
      num_options: K.
    """

    num_options: int

    @nn.compact
    def __call__(self, change: jax.Array) -> jax.Array:
        """Return how far changes [..., O] go along each option's direction, [..., K]."""
        shape = self.num_options, change.shape[-1]
        rows = self.param("directions", nn.initializers.normal(1.0, jnp.float32), shape)
        # Adding a vector to all rows changes no q. Two options on a line get both its directions.
        apart = rows - rows.mean(0)
        return change @ (apart / jnp.sqrt((apart**2).sum(-1, keepdims=True) + EPSILON)).T
