"""The variational bound behind MOPG, by enumeration of all trajectories (Theorems 4.1 and E.1)."""

import dataclasses

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.hit_mdp import (
    HiTMDP,
    hidden_temporal_operator,
    markovian_option_value,
    option_action_value,
)
from hitmdp_jax.theory.trajectories import enumerate_trajectories


@struct.dataclass
class Evidence:
    r"""The three terms of log q(e) = ELBO + KL, in nats.

    P is the HiT-MDP's trajectory distribution (Eq. 26). q has the same start and dynamics, uniform
    priors over options and actions (Eq. 9), and the likelihood of being optimal

    .. math::
      q(e^A | s, a) = \exp(r(s, a) - \max r), \qquad
      q(e^O | s, a, o, o_{t-1}) = \exp(I(o | s, a, o_{t-1}) - \max I)

    Eq. 10-11 print sums over a and over o in place of the maxima. Those depend on the state, so
    Eq. 12 and Eq. 13 would not follow (docs/errata.md).
    """

    log_evidence: jax.Array  # log q(e_{1:T})
    elbo: jax.Array  # E_P[log q(tau, e_{1:T}) - log P(tau)]
    kl: jax.Array  # KL[P(tau) || q(tau | e_{1:T})]


def evidence(
    hit: HiTMDP, start: jax.Array, horizon: int, prior: jax.Array | None = None
) -> Evidence:
    """Return the evidence of T optimal steps, its lower bound and the gap (Theorem 4.1, Eq. 43).

    `Evidence` says what P and q are. The gap is a KL divergence, so the bound is tight where
    P(tau) = q(tau | e); random dynamics put that out of any policy's reach.

    Args:
      hit: the HiT-MDP; its gamma and entropy weights play no role.
      start: [S, K_prev] distribution of (s_1, o_0).
      horizon: T; all K (S K A)^T trajectories are visited.
      prior: p(o | o_{t-1}) [K_prev, K]; None is the paper's, uniform.
    """
    num_states, num_options, _ = hit.master.shape
    num_actions = hit.reward.shape[-1]
    tau = enumerate_trajectories(num_states, num_options, num_actions, horizon)
    initial = jnp.arange(num_options)[:, None, None]
    state, option, action = (x[None] for x in (tau.state, tau.option, tau.action))  # [1, N, T]
    first = jnp.broadcast_to(initial, (num_options, *option.shape[1:2], 1))
    later = jnp.broadcast_to(option[..., :-1], (num_options, *option[..., :-1].shape[1:]))
    previous = jnp.concatenate([first, later], axis=-1)  # [K, N, T]

    shape = (*hit.master.shape, num_actions)
    information = jnp.broadcast_to(hit.information, shape)
    optimal = (
        hit.reward - hit.reward.max() + (information - information.max()).transpose(1, 2, 0, 3)
    )
    log_optimal = optimal[previous, option, state, action].sum(-1)
    log_dynamics = jnp.log(start[state[..., 0], previous[..., 0]])
    moving = hit.transition[state[..., :-1], action[..., :-1], state[..., 1:]]
    log_dynamics += jnp.log(moving).sum(-1)
    log_policy = jnp.log(hit.master[state, previous, option]) + jnp.log(
        hit.action[option, state, action]
    )

    if prior is None:
        prior = jnp.full((num_options, num_options), 1.0 / num_options)
    log_prior = jnp.log(prior)[previous, option].sum(-1) - horizon * jnp.log(num_actions)
    log_joint = log_dynamics + log_optimal + log_prior
    log_p = log_dynamics + log_policy.sum(-1)
    log_evidence = jax.nn.logsumexp(log_joint)
    log_posterior = log_joint - log_evidence
    return Evidence(
        log_evidence=log_evidence,
        elbo=_expectation(log_p, log_joint - log_p),
        kl=_expectation(log_p, log_p - log_posterior),
    )


def elbo_objective(hit: HiTMDP, start: jax.Array, horizon: int) -> jax.Array:
    r"""Return sum_t E[r + I + H(pi_O) + H(pi_A)] over T steps (Eq. 13), by backward recursion.

    It differs from the ELBO of `evidence` by a constant: T (log K A + max r + max I).

    Args:
      hit: the HiT-MDP; its gamma and entropy weights are replaced by 1.
      start: [S, K_prev] distribution of (s_1, o_0).
      horizon: T.
    """
    soft = dataclasses.replace(hit, gamma=1.0, option_entropy=1.0, action_entropy=1.0)
    last = option_action_value(soft, jnp.zeros_like(start))
    q_action = jax.lax.fori_loop(
        0, horizon - 1, lambda _, q: hidden_temporal_operator(soft, q), last
    )
    return (start * markovian_option_value(soft, q_action)).sum()


def option_log_posterior(hit: HiTMDP) -> jax.Array:
    """Return log P(o | s, a, o_{t-1}) [S, K_prev, K, A], by Bayes' rule from the two policies.

    As the intrinsic reward I it is the one for which Theorem 4.1 holds although I depends on the
    policies: exp(I) sums to one over o, so the evidence does not depend on them.
    """
    joint = hit.master[..., None] * jnp.moveaxis(hit.action, 0, 1)[:, None]
    return jnp.log(joint / joint.sum(2, keepdims=True))


def _expectation(log_p: jax.Array, x: jax.Array) -> jax.Array:
    """Return sum p x, where p = 0 counts for nothing whatever x is."""
    return jnp.where(
        log_p > -jnp.inf, jnp.exp(log_p) * jnp.where(log_p > -jnp.inf, x, 0.0), 0.0
    ).sum()
