"""The intrinsic reward I_t of the ELBO (Thm 4.1), in closed form over K options."""

import jax
import jax.numpy as jnp

from hitmdp_jax.learning.options import at_option

CHOICES = ("none", "action", "usage", "previous")


def usage(option: jax.Array, num_options: int) -> jax.Array:
    """Return the share [K] of each option among the options [...] of a batch."""
    return jax.nn.one_hot(option.ravel(), num_options, dtype=jnp.float32).mean(axis=0)


def option_posterior(log_master: jax.Array, log_action: jax.Array) -> jax.Array:
    """Return log P(o | s, a, o_{t-1}) [..., K] by Bayes' rule from the two policies.

    Args:
      log_master: [..., K] log P(o | s, o_{t-1}).
      log_action: [..., K] log P(a | s, o) of the action taken.
    """
    return jax.nn.log_softmax(log_master + log_action, axis=-1)


def action_information(
    log_master: jax.Array, log_action: jax.Array, option: jax.Array
) -> jax.Array:
    """Return log P(a | s, o_t) - log sum_o P(o | s, o_{t-1}) P(a | s, o), in nats [...].

    What the option says of the action. Args as in `option_posterior`; option: [...], o_t.
    """
    marginal = jax.nn.logsumexp(log_master + log_action, axis=-1)
    return at_option(log_action, option) - marginal


def usage_information(log_master: jax.Array, log_action: jax.Array, option: jax.Array) -> jax.Array:
    """Return log P(o_t | s, a, o_{t-1}) - log p(o_t), in nats [...], p the batch's option usage.

    What state and action say of the option, beyond how often it is used.
    """
    log_usage = jnp.log(usage(option, log_master.shape[-1]))
    return at_option(option_posterior(log_master, log_action) - log_usage, option)


def previous_information(
    log_master: jax.Array, log_action: jax.Array, option: jax.Array, log_marginal: jax.Array
) -> jax.Array:
    """Return log P(o_t | s, a, o_{t-1}) - log P(o_t | s, a), in nats [...].

    What the previous option adds to state and action.

    Args:
      log_master: [..., K] log P(o | s, o_{t-1}).
      log_action: [..., K] log P(a | s, o) of the action taken.
      option: [...], o_t.
      log_marginal: [..., K] log P(o | s), the previous option marginalised out.
    """
    posterior = option_posterior(log_master, log_action)
    return at_option(posterior - option_posterior(log_marginal, log_action), option)
