"""Advantage estimation over rollouts with terminations and time limits kept apart."""

import chex
import jax
import jax.numpy as jnp


def generalized_advantages(
    reward: jax.Array,
    value: jax.Array,
    next_value: jax.Array,
    terminated: jax.Array,
    truncated: jax.Array,
    gamma: jax.Array | float,
    gae_lambda: jax.Array | float,
    bootstrap_on_truncation: bool = True,
) -> jax.Array:
    r"""Return the GAE(lambda) advantages of a rollout (Schulman et al. 2016, Eq. 16).

    .. math::
      \delta_t = r_t + \gamma (1 - d_t) V'_t - V_t, \qquad
      A_t = \delta_t + \gamma \lambda (1 - e_t) A_{t+1}

    where e_t says that the episode ended at t, and d_t that nothing follows: the termination alone
    or, without bootstrapping, any end. `next_value` is a separate argument because the state that
    step t reached is not the state of step t+1 when the environment restarted in between.

    Args:
      reward: [T, B].
      value: [T, B], V at the state of step t.
      next_value: [T, B], V' at the state step t reached, before any reset.
      terminated: [T, B] bool, the task ended the episode at t.
      truncated: [T, B] bool, the time limit ended it.
      gamma: discount factor.
      gae_lambda: the mixing factor lambda.
      bootstrap_on_truncation: False treats a time limit as a termination, as DAC's public code
        and the numbers published with it do.

    Returns:
      [T, B] advantages, not normalised.
    """
    chex.assert_equal_shape([reward, value, next_value, terminated, truncated])
    ended = terminated | truncated
    nothing_follows = terminated if bootstrap_on_truncation else ended
    delta = reward + gamma * jnp.where(nothing_follows, 0.0, next_value) - value
    decay = gamma * gae_lambda * (1.0 - ended.astype(reward.dtype))

    def backward(advantage: jax.Array, inputs: tuple[jax.Array, jax.Array]):
        delta_t, decay_t = inputs
        advantage = delta_t + decay_t * advantage
        return advantage, advantage

    _, advantages = jax.lax.scan(backward, jnp.zeros_like(delta[0]), (delta, decay), reverse=True)
    return advantages


def discounted_returns(
    reward: jax.Array,
    next_value: jax.Array,
    terminated: jax.Array,
    truncated: jax.Array,
    gamma: jax.Array | float,
    bootstrap_on_truncation: bool = True,
) -> jax.Array:
    r"""Return the discounted rewards to the episode's or the rollout's end, and the value there.

    .. math::
      R_t = r_t + \gamma R_{t+1}, \qquad R_T = r_T + \gamma V'_T \text{ at the end}

    Args:
      reward: [T, B].
      next_value: [T, B], V' at the state step t reached; read where an episode or the rollout ends.
      terminated: [T, B] bool, the task ended the episode at t.
      truncated: [T, B] bool, the time limit ended it.
      gamma: discount factor.
      bootstrap_on_truncation: False treats a time limit as a termination.

    Returns:
      [T, B] returns, the targets of a critic.
    """
    # GAE(1) over the values 0 sums the rewards; the value enters with the last one.
    ended = jnp.logical_or(terminated, truncated)
    nothing_follows = terminated if bootstrap_on_truncation else ended
    last = ended.at[-1].set(True)
    reward = reward + gamma * jnp.where(last & ~nothing_follows, next_value, 0.0)
    zero = jnp.zeros_like(reward)
    return generalized_advantages(reward, zero, zero, terminated, truncated, gamma, 1.0)


def deviation(x: jax.Array) -> jax.Array:
    """Return the divisor of `standardize`; other terms of a loss are divided by it, too."""
    return x.std() + 1e-8


def in_deviations(weight: jax.Array | float, advantage: jax.Array) -> jax.Array:
    """Return the weight [T, B] of an entropy in a loss that has the standardised advantage [T, B].

    The entropy in the reward carries what actions do to later entropies, and not its own gradient
    (docs/errata.md, 16).
    """
    return jnp.full_like(advantage, weight / deviation(advantage))


def standardize(x: jax.Array) -> jax.Array:
    """Return x with mean 0 and standard deviation 1 over all its entries."""
    return (x - x.mean()) / deviation(x)
