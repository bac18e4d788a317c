"""Options as agents and records see them: transitions, terminations, usage and durations."""

from typing import Any

import distrax
import jax
import jax.numpy as jnp
import numpy as np
from flax import struct


class OptionMemory(struct.PyTreeNode):
    """What a call-and-return policy remembers."""

    previous: jax.Array  # [...] int, o_{t-1}; any option where `initial`
    initial: jax.Array  # [...] bool: an episode starts, no option is under way


def at_option(values: jax.Array, option: jax.Array) -> jax.Array:
    """Return the entries [...] of values [..., K] at the options [...].

    A masked sum: it fuses with its neighbours, unlike a gather and its gradient, and an infinity
    elsewhere does no harm.
    """
    mask = jax.nn.one_hot(option, values.shape[-1], dtype=bool)
    return jnp.where(mask, values, 0.0).sum(-1)


def option_transition(
    log_master: jax.Array, termination: jax.Array, previous: jax.Array
) -> jax.Array:
    r"""Return log P(o_t | s_t, o_{t-1}), [..., K], of the call-and-return policy (HiT-MDP Eq. 22).

    .. math::
      P(o | s, o_{t-1}) = (1 - \beta_{o_{t-1}}(s)) \, 1[o = o_{t-1}] + \beta_{o_{t-1}}(s) \pi(o | s)

    Args:
      log_master: [..., K] log pi(o | s).
      termination: [...] logit of beta, the termination of the PREVIOUS option in s.
      previous: [...] int, o_{t-1}.
    """
    log_continue, log_stop = jax.nn.log_sigmoid(-termination), jax.nn.log_sigmoid(termination)
    same = jax.nn.one_hot(previous, log_master.shape[-1], dtype=bool)
    stay = jnp.where(same, log_continue[..., None], -jnp.inf)
    return jnp.logaddexp(stay, log_stop[..., None] + log_master)


def option_belief(
    log_posterior: jax.Array, log_master: jax.Array, termination: jax.Array, initial: jax.Array
) -> jax.Array:
    r"""Return log P(o_t | s_0..s_t, a_0..a_{t-1}), [..., K] (Smith et al. 2018, Sect. 4).

    .. math::
      b_t(o) = \sum_{o'} P(o | s_t, o') \, P(o_{t-1} = o' | s_0..s_{t-1}, a_0..a_{t-1})

    Args:
      log_posterior: [..., K] log-probabilities of o_{t-1}, having seen a_{t-1}.
      log_master: [..., K] log pi(o | s_t).
      termination: [..., K] logits of beta_o(s_t).
      initial: [...] bool, an episode starts: the belief is the master's.
    """
    every = jnp.arange(log_master.shape[-1])
    transition = option_transition(log_master[..., None, :], termination, every)  # [.., K', K]
    going_on = jax.nn.logsumexp(log_posterior[..., None] + transition, axis=-2)
    return jnp.where(initial[..., None], log_master, going_on)


def entropy(log_probs: jax.Array) -> jax.Array:
    """Return the entropy [...] in nats of log-probabilities [..., K], which may be -inf."""
    probs = jnp.exp(log_probs)
    return -jnp.where(probs > 0, probs * log_probs, 0.0).sum(-1)


def log_sticky(previous: jax.Array, num_options: int, stay: jax.Array | float) -> jax.Array:
    """Return the log-probabilities [..., K] of the sticky prior p(o_t | o_{t-1}).

    It stays with o_{t-1} with probability `stay` and goes to each other option with an equal share
    of the rest. So by the prior an option lasts 1 / (1 - stay) steps, and going to one certain
    other option costs log(stay (K - 1) / (1 - stay)) nats more than staying does.

    Args:
      previous: [...] int, o_{t-1}.
      num_options: K; a single option stays whatever `stay` says.
      stay: probability in (0, 1).
    """
    if num_options == 1:
        return jnp.zeros((*previous.shape, 1), jnp.float32)
    same = jax.nn.one_hot(previous, num_options, dtype=bool)
    return jnp.where(same, jnp.log(stay), jnp.log((1.0 - stay) / (num_options - 1)))


def kl_to_prior(log_probs: jax.Array, log_prior: jax.Array) -> jax.Array:
    """Return KL(P || p) [...] in nats of log-probabilities [..., K]; log p is finite."""
    probs = jnp.exp(log_probs)
    return jnp.where(probs > 0, probs * (log_probs - log_prior), 0.0).sum(-1)


def tilted(log_prior: jax.Array, q: jax.Array, weight: jax.Array | float) -> jax.Array:
    r"""Return the log-probabilities [..., K] that are best for values q [..., K] under a prior.

    They maximise \sum_o P(o) Q(o) - weight KL(P \| p), so P(o) \propto p(o) exp(Q(o) / weight).

    Args:
      log_prior: [..., K], log p.
      q: [..., K], values; both broadcast.
      weight: of the divergence, in values per nat.
    """
    return jax.nn.log_softmax(log_prior + q / weight)


def drawn_option(log_probs: jax.Array, key: jax.Array, deterministic: bool) -> jax.Array:
    """Draw options [...] by their log-probabilities [..., K], or take the likeliest."""
    options: Any = distrax.Categorical(log_probs)
    option = options.mode() if deterministic else options.sample(seed=key)
    return option.astype(jnp.int32)


def standardize_by_option(x: jax.Array, option: jax.Array, num_options: int) -> jax.Array:
    """Return x [T, B] with mean 0 and standard deviation 1 over the steps of each option.

    Options whose rewards have different units then learn at one pace.
    """
    of_option = jax.nn.one_hot(option, num_options, dtype=x.dtype)  # [T, B, K]
    steps = jnp.maximum(of_option.sum((0, 1)), 1.0)
    mean = (of_option * x[..., None]).sum((0, 1)) / steps
    centred = x - of_option @ mean
    variance = (of_option * jnp.square(centred)[..., None]).sum((0, 1)) / steps
    return centred / (jnp.sqrt(of_option @ variance) + 1e-8)


def change_under_option(
    obs: jax.Array, next_obs: jax.Array, option: jax.Array, ended: jax.Array, steps: int
) -> jax.Array:
    """Return what an option changes in some steps, (s_{t+n} - s_t) steps / n, [T, B, O].

    n is `steps`, or less where the option is left, the episode ends or the rollout does. There the
    change is taken to go on at the same pace, so that being left early costs an option nothing.

    Args:
      obs: [T, B, O], s_t.
      next_obs: [T, B, O], s_{t+1}, before any reset.
      option: [T, B] int, o_t.
      ended: [T, B] bool, the episode ended at t.
      steps: at least 1.
    """
    last = (ended | (option != jnp.roll(option, -1, axis=0))).at[-1].set(True)
    reached, goes_on, taken = next_obs, ~last, jnp.ones(last.shape)
    for n in range(1, steps):
        reached = jnp.where(goes_on[..., None], jnp.roll(next_obs, -n, axis=0), reached)
        taken = jnp.where(goes_on, n + 1.0, taken)
        goes_on &= ~jnp.roll(last, -n, axis=0)
    return (reached - obs) * (steps / taken)[..., None]


def even_weights(option: jax.Array, num_options: int, least: float = 0.02) -> jax.Array:
    """Return weights [T, B] of options [T, B] under which each option counts the same.

    An option's weight is 1 / (K share), where `share` is its part of all steps. An option that has
    less than the share `least` is weighted as if it had that one.
    """
    share = jax.nn.one_hot(option, num_options, dtype=jnp.float32).mean((0, 1))
    return at_option(1.0 / (num_options * jnp.maximum(share, least)), option)


def expected_value(log_probs: jax.Array, q: jax.Array) -> jax.Array:
    """Return V[s, o_{t-1}] = sum_o P(o | s, o_{t-1}) Q[s, o], of shape [...] (HiT-MDP Eq. 6).

    Args:
      log_probs: [..., K] log P(o | s, o_{t-1}).
      q: [..., K] Q[s, o].
    """
    return (jnp.exp(log_probs) * q).sum(-1)


def value_of_next_option(
    q_next: jax.Array, log_prob_next: jax.Array, option: jax.Array, ended: jax.Array
) -> jax.Array:
    """Return Q[s_{t+1}, o_{t+1}], of shape [T, B], as a rollout's intra-option advantage needs it.

    The next option is the one drawn, except where the episode or the rollout ends: there it is
    averaged over P(o | s_{t+1}, o_t).

    Args:
      q_next: [T, B, K] Q[s', o] in the states reached.
      log_prob_next: [T, B, K] log P(o | s', o_t).
      option: [T, B] int, o_t.
      ended: [T, B] bool, the episode ended at t.
    """
    drawn = at_option(q_next, jnp.roll(option, -1, axis=0))
    return jnp.where(ended.at[-1].set(True), expected_value(log_prob_next, q_next), drawn)


def termination_objective(
    termination: jax.Array,
    q: jax.Array,
    value: jax.Array,
    memory: OptionMemory,
    regularizer: jax.Array | float,
) -> jax.Array:
    r"""Return the loss [N] of the termination gradient theorem (Bacon et al. 2017, Thm 2).

    .. math::
      \beta_{o_{t-1}}(s_t) \, (Q[s_t, o_{t-1}] - V[s_t] + \xi)

    The brackets hold the advantage of going on, held constant; no option is under way at an
    episode's start.

    Args:
      termination: [N, K] logits of beta_o(s_t).
      q: [N, K] Q[s_t, o].
      value: [N] V[s_t], the value of choosing anew.
      memory: [N] o_{t-1}.
      regularizer: xi, a small advantage granted to every option, so that options last.
    """
    advantage = at_option(q, memory.previous) - value + regularizer
    stop = jax.nn.sigmoid(at_option(termination, memory.previous))
    return stop * jax.lax.stop_gradient(jnp.where(memory.initial, 0.0, advantage))


def option_statistics(
    option: jax.Array, previous: jax.Array, started: jax.Array, num_options: int
) -> dict[str, jax.Array]:
    """Count each option's steps and activations in a rollout.

    An activation is a step that starts an episode or takes another option than the step before.
    Steps over activations is an option's mean duration; both are sums, so that durations over any
    window of iterations follow by adding up.

    Args:
      option: [T, B] int, o_t.
      previous: [T, B] int, o_{t-1}.
      started: [T, B] bool, the first step of an episode.
      num_options: K.

    Returns:
      `option_steps` [K] and `option_activations` [K], float counts.
    """
    one_hot = jax.nn.one_hot(option, num_options, dtype=jnp.float32)
    activated = started | (option != previous)
    return {
        "option_steps": one_hot.sum(axis=(0, 1)),
        "option_activations": (one_hot * activated[..., None]).sum(axis=(0, 1)),
    }


def mean_duration(steps: np.ndarray, activations: np.ndarray) -> np.ndarray:
    """Return mean option duration in steps, from summed counts.

    An option that ran on throughout counts as activated once; the duration of one that never ran is
    NaN.
    """
    return np.where(steps > 0, steps / np.maximum(activations, 1.0), np.nan)
