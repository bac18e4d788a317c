"""The intrinsic reward I_t of the ELBO (Thm 4.1), in closed form over K options."""

import jax
import jax.numpy as jnp

CHOICES = ("none", "action", "usage", "previous")


def taken(log_probs: jax.Array, option: jax.Array) -> jax.Array:
    """Return the entries [N] of log_probs [N, K] at the options [N]."""
    return jnp.take_along_axis(log_probs, option[:, None], axis=-1).squeeze(-1)


def option_posterior(log_master: jax.Array, log_action: jax.Array) -> jax.Array:
    """Return log P(o | s, a, o_{t-1}) [N, K] by Bayes' rule from the two policies.

    Args:
      log_master: [N, K] log P(o | s, o_{t-1}).
      log_action: [N, K] log P(a | s, o) of the action taken.
    """
    return jax.nn.log_softmax(log_master + log_action, axis=-1)


def action_information(
    log_master: jax.Array, log_action: jax.Array, option: jax.Array
) -> jax.Array:
    """Return log P(a | s, o_t) - log sum_o P(o | s, o_{t-1}) P(a | s, o), in nats [N].

    What the option says of the action. Args as in `option_posterior`; option: [N], o_t.
    """
    marginal = jax.nn.logsumexp(log_master + log_action, axis=-1)
    return taken(log_action, option) - marginal


def usage_information(log_master: jax.Array, log_action: jax.Array, option: jax.Array) -> jax.Array:
    """Return log P(o_t | s, a, o_{t-1}) - log p(o_t), in nats [N], p the batch's option usage.

    What state and action say of the option, beyond how often it is used.
    """
    usage = jax.nn.one_hot(option, log_master.shape[-1]).mean(axis=0)
    return taken(option_posterior(log_master, log_action), option) - jnp.log(usage)[option]


def previous_information(
    log_master: jax.Array, log_action: jax.Array, option: jax.Array, log_marginal: jax.Array
) -> jax.Array:
    """Return log P(o_t | s, a, o_{t-1}) - log P(o_t | s, a), in nats [N].

    What the previous option adds to state and action.

    Args:
      log_master: [N, K] log P(o | s, o_{t-1}).
      log_action: [N, K] log P(a | s, o) of the action taken.
      option: [N], o_t.
      log_marginal: [N, K] log P(o | s), the previous option marginalised out.
    """
    posterior = option_posterior(log_master, log_action)
    return taken(posterior - option_posterior(log_marginal, log_action), option)
