"""The intrinsic reward I_t of the ELBO (Thm 4.1), in closed form over K options."""

import jax

from hitmdp_jax.learning.options import at_option


def action_information(
    log_master: jax.Array, log_action: jax.Array, option: jax.Array
) -> jax.Array:
    """Return log P(a | s, o_t) - log sum_o P(o | s, o_{t-1}) P(a | s, o), in nats [...].

    It is what the option says of the action.

    Args:
      log_master: [..., K] log P(o | s, o_{t-1}).
      log_action: [..., K] log P(a | s, o) of the action taken.
      option: [...] int, o_t.
    """
    marginal = jax.nn.logsumexp(log_master + log_action, axis=-1)
    return at_option(log_action, option) - marginal
