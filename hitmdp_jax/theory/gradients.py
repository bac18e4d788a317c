"""The exact gradients that MOPG estimates (Theorems 4.2 and 4.3, App. E.2 and E.3).

Each function returns dJ/dP, the derivative in every entry of a policy table. For any parameters
theta of the policy, dJ/dtheta = sum dJ/dP dP/dtheta, which is what `jax.vjp` of theta -> P does.
"""

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.hit_mdp import HiTMDP, expected_information, hidden_values, occupancy


@struct.dataclass
class PolicyGradient:
    """The derivatives of one scalar in both policy tables of a HiT-MDP."""

    master: jax.Array  # [S, K_prev, K]
    action: jax.Array  # [K, S, A]


def entropy_slope(policy: jax.Array) -> jax.Array:
    """Return dH/dP = -(log P + 1), elementwise; 0 at probability 0, as `entropy` has it."""
    return jnp.where(policy > 0, -jnp.log(jnp.where(policy > 0, policy, 1.0)) - 1.0, 0.0)


def master_policy_gradient(hit: HiTMDP, start: jax.Array) -> jax.Array:
    r"""Return d V-bar[start] / d pi_O, [S, K_prev, K] (Theorem 4.2, corrected).

    .. math::
      \frac{\partial \bar V[s_t, o_{t-1}]}{\partial \theta} = \sum_{s', o} d[s', o]
        \Big( \sum_{o'} \frac{\partial \pi_O(o' | s', o)}{\partial \theta}
          \big( Q_O[s', o'] + I(o' | s', o) \big)
        + w_O \frac{\partial H(\pi_O(\cdot | s', o))}{\partial \theta} \Big)

    with d the discounted visits to (s', o) from `start`, which sum to 1 / (1 - gamma), and
    I(o' | s', o) = E_a[I(o' | s', a, o)], held constant. Eq. 14 as printed leaves I outside the
    derivative's sum and the entropy underived.

    Args:
      hit: the HiT-MDP.
      start: [S, K_prev] distribution of (s_t, o_{t-1}); one-hot for the theorem's own statement.
    """
    values, visited = hidden_values(hit), occupancy(hit, start)
    worth = values.q_option[:, None] + expected_information(hit)
    return visited[:, :, None] * (worth + hit.option_entropy * entropy_slope(hit.master))


def action_policy_gradient(hit: HiTMDP, start: jax.Array) -> jax.Array:
    r"""Return d Q_O[start] / d pi_A, [K, S, A] (Theorem 4.3, corrected).

    .. math::
      \frac{\partial Q_O[s_t, o_t]}{\partial \theta} = \sum_{s, o} d[s, o]
        \Big( \sum_a \frac{\partial \pi_A(a | s, o)}{\partial \theta} Q_A[s, o, a]
        + w_A \frac{\partial H(\pi_A(\cdot | s, o))}{\partial \theta} \Big)

    with d the discounted visits to (s, o_t) from `start`. Where I depends on the action, Q_A gains
    I(o | s, a, o_prev) at every later step, averaged over the o_prev that led there.

    Args:
      hit: the HiT-MDP.
      start: [S, K] distribution of (s_t, o_t); one-hot for the theorem's own statement.
    """
    values = hidden_values(hit)
    arrive = hit.gamma * jnp.einsum("so,osa,sat->to", start, hit.action, hit.transition)
    here = start[:, :, None] * (values.q_action + _action_entropy_slope(hit))
    return jnp.moveaxis(here, 1, 0) + _action_gradient_of_v_bar(hit, arrive)


def policy_gradient(hit: HiTMDP, start: jax.Array) -> PolicyGradient:
    """Return the gradient of `objective(hit, start)`, the ELBO's discounted form, in both policies.

    This is the ascent direction of MOPG: Theorem 4.2, and Theorem 4.3 summed over the first option.
    """
    return PolicyGradient(
        master=master_policy_gradient(hit, start), action=_action_gradient_of_v_bar(hit, start)
    )


def _action_gradient_of_v_bar(hit: HiTMDP, start: jax.Array) -> jax.Array:
    """Return d V-bar[start] / d pi_A, [K, S, A], for start [S, K_prev] over (s_t, o_{t-1})."""
    values = hidden_values(hit)
    joint = occupancy(hit, start)[:, :, None] * hit.master  # [S, K_prev, K]
    worth = values.q_action + _action_entropy_slope(hit)
    information = jnp.broadcast_to(hit.information, (*joint.shape, worth.shape[-1]))
    gradient = joint.sum(1)[..., None] * worth + jnp.einsum("spo,spoa->soa", joint, information)
    return jnp.moveaxis(gradient, 1, 0)


def _action_entropy_slope(hit: HiTMDP) -> jax.Array:
    return hit.action_entropy * jnp.moveaxis(entropy_slope(hit.action), 0, 1)  # [S, K, A]
