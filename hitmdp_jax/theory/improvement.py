"""Policy improvement and iteration on a HiT-MDP (Theorem E.2)."""

import dataclasses

import jax
import jax.numpy as jnp

from hitmdp_jax.theory.hit_mdp import (
    HiddenValues,
    HiTMDP,
    expected_information,
    hidden_temporal_operator,
    hidden_values,
    option_value,
)

GREEDY = 1e-10  # the entropy weight that stands for 0: values closer than this are tied


def greedy(hit: HiTMDP, q_action: jax.Array) -> HiTMDP:
    r"""Return the HiT-MDP with both policies made greedy, or soft-greedy, for Q_A [S, K, A].

    First the action policy, then the master policy on the option values that result:

    .. math::
      \pi_A'(a | s, o) \propto \exp((Q_A[s, o, a] + I(o | s, a)) / w_A), \qquad
      \pi_O'(o | s, o_{t-1}) \propto \exp((Q_O'[s, o] + I(o | s, o_{t-1})) / w_O)

    An entropy weight of 0 gives the argmax, ties shared evenly.
    """
    shape = (*hit.master.shape, hit.reward.shape[-1])
    # Under the condition of `improve` the mean over o_{t-1} loses only what softmax ignores.
    worth = q_action + jnp.broadcast_to(hit.information, shape).mean(1)
    hit = dataclasses.replace(hit, action=jnp.moveaxis(_boltzmann(worth, hit.action_entropy), 1, 0))
    worth = option_value(hit, q_action)[:, None] + expected_information(hit)
    return dataclasses.replace(hit, master=_boltzmann(worth, hit.option_entropy))


def improve(hit: HiTMDP) -> HiTMDP:
    """Return the HiT-MDP with both policies improved on its own values: no V-bar falls.

    Theorem E.2 needs a condition that is not printed: I(o | s, a, o_{t-1}) must be a sum
    f(s, o, a) + g(s, o_{t-1}, o). The action policy does not see o_{t-1}; where the best action
    depends on it, no action policy is best for every augmented state (docs/errata.md).
    """
    return greedy(hit, hidden_values(hit).q_action)


def policy_iteration(hit: HiTMDP, num_iterations: int) -> tuple[HiTMDP, HiddenValues]:
    """Evaluate and improve `num_iterations` times (Theorem E.2).

    Returns:
      The last HiT-MDP, and the values before each improvement, a leading axis [num_iterations].
    """

    def step(policies: tuple[jax.Array, jax.Array], _: None):
        current = dataclasses.replace(hit, master=policies[0], action=policies[1])
        better = improve(current)
        return (better.master, better.action), hidden_values(current)

    (master, action), history = jax.lax.scan(
        step, (hit.master, hit.action), None, length=num_iterations
    )
    return dataclasses.replace(hit, master=master, action=action), history


def optimality_operator(hit: HiTMDP, q_action: jax.Array) -> jax.Array:
    """Apply T^H under the policies that are greedy for Q_A [S, K, A]: a step of value iteration.

    Its fixed point is the Q_A of the best policies, under the condition of `improve`. With
    information 0 the best master policy is the same for every o_{t-1}: what would remember the
    option under way is the intrinsic reward, not the return.
    """
    return hidden_temporal_operator(greedy(hit, q_action), q_action)


def _boltzmann(worth: jax.Array, weight: jax.Array | float) -> jax.Array:
    """Return the distribution over the last axis proportional to exp(worth / weight)."""
    return jax.nn.softmax(
        (worth - worth.max(-1, keepdims=True)) / jnp.maximum(weight, GREEDY), axis=-1
    )
