"""A structural prior P(o_t | o_{t-1}) of the graphical model (Eq. 9) that is not uniform."""

import dataclasses

import jax
import jax.numpy as jnp

from hitmdp_jax.theory.hit_mdp import HiTMDP


def sticky_prior(num_options: int, stay: jax.Array | float) -> jax.Array:
    """Return p(o | o_{t-1}) [K_prev, K]: `stay` on the diagonal, the rest shared evenly."""
    same = jnp.eye(num_options, dtype=bool)
    return jnp.where(same, stay, (1.0 - jnp.asarray(stay)) / max(num_options - 1, 1))


def with_prior(hit: HiTMDP, prior: jax.Array) -> HiTMDP:
    r"""Return the HiT-MDP whose soft return is the ELBO under a prior [K_prev, K] over options.

    Theorem 4.1 takes the prior uniform, and it drops out as a constant. Another one stays:

    .. math::
      E[r + I + \log p(o_t | o_{t-1}) + H(\pi_O) + H(\pi_A)]
        = E[r + I - KL(\pi_O \| p) + H(\pi_A)]

    So a prior is an intrinsic reward that depends on o_{t-1}, in nats: leaving an option costs
    what the prior says it costs.
    """
    return dataclasses.replace(hit, information=hit.information + jnp.log(prior)[None, :, :, None])


def best_master(q_option: jax.Array, prior: jax.Array, weight: jax.Array | float) -> jax.Array:
    r"""Return the master policy [S, K_prev, K] that is best for Q_O [S, K] under a prior.

    It maximises \sum_o P(o) Q_O[s, o] - weight KL(P || p), so

    .. math::
      P(o | s, o_{t-1}) \propto p(o | o_{t-1}) \exp(Q_O[s, o] / weight)

    Only through the prior does it depend on o_{t-1}: under the uniform one it forgets the option.
    """
    return jax.nn.softmax(jnp.log(prior)[None] + q_option[:, None] / weight, axis=-1)
