"""The values of an option framework, as its equivalent HiT-MDP has them (sec. 3.2, App. D.1)."""

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.hit_mdp import HiTMDP, hidden_temporal_operator, hidden_values, hit_mdp
from hitmdp_jax.theory.model import OptionModel, as_float, initiable_master_policy


@struct.dataclass
class Values:
    """The value functions of an SMDP option framework."""

    v_bar: jax.Array  # [S, K_prev] E[G_t | s_t, o_{t-1}] (Eq. 6)
    q_option: jax.Array  # [S, K] E[G_t | s_t, o_t] (Eq. 28)
    q_action: jax.Array  # [S, K, A] E[G_t | s_t, o_t, a_t] (Eq. 7)
    v: jax.Array  # [S] E[G_t | s_t] where the master policy picks the option anew (Eq. 27)


def evaluate(model: OptionModel) -> Values:
    r"""Return the values of the model's policies, exactly (Theorem 3.3, by a linear solve).

    `v` is Eq. 27 with the SMDP master policy P(o | s) of Eq. 18:

    .. math::
      V[s] = \sum_o P(o | s) Q_O[s, o],

    what a state is worth when no option is under way. It is NOT the mean return over visits to s,
    which weighs V-bar by how often each o_{t-1} brings the agent there: see
    `variance.expected_value` and the note on Proposition 3.4 in docs/errata.md.
    """
    values = hidden_values(hit_mdp(model))
    v = (initiable_master_policy(model) * values.q_option).sum(-1)
    return Values(values.v_bar, values.q_option, values.q_action, v)


def bellman_operator(model: OptionModel | HiTMDP, q_action: jax.typing.ArrayLike) -> jax.Array:
    """Apply the Hidden Temporal Bellman operator T^H to Q_A [S, K, A] (Theorem 3.2, Eq. 8)."""
    return hidden_temporal_operator(hit_mdp(model), as_float(q_action))


def evaluate_by_iteration(
    model: OptionModel | HiTMDP, num_iterations: int, q_action: jax.Array | None = None
) -> jax.Array:
    """Return Q_A [S, K, A] after applying T^H `num_iterations` times (Theorem 3.3).

    From zero, the default, and without intrinsic rewards this is the expected return of the first
    `num_iterations` steps. The limit is the value of the policies at hand, not the optimal one as
    sec. 3.2 says in passing.
    """
    hit = hit_mdp(model)
    num_states, _, num_options = hit.master.shape
    if q_action is None:
        q_action = jnp.zeros((num_states, num_options, hit.reward.shape[-1]), hit.master.dtype)
    return jax.lax.fori_loop(
        0, num_iterations, lambda _, q: hidden_temporal_operator(hit, q), as_float(q_action)
    )


def distances_to_fixed_point(model: OptionModel | HiTMDP, num_iterations: int) -> jax.Array:
    r"""Return how far iteration from Q = 0 is from Q_A, [num_iterations + 1] (Theorem 3.3).

    .. math::
      d_n = \|(T^H)^n 0 - Q_A\|_\infty \le \gamma^n d_0

    Q_A is the linear solve's, so that in floating point d_n ends at its rounding error.
    """
    hit = hit_mdp(model)
    fixed_point = hidden_values(hit).q_action

    def step(q_action: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
        distance = jnp.abs(q_action - fixed_point).max()
        return hidden_temporal_operator(hit, q_action), distance

    return jax.lax.scan(step, jnp.zeros_like(fixed_point), length=num_iterations + 1)[1]


def option_value_upon_arrival(model: OptionModel) -> jax.Array:
    r"""Return U[s, o], the value of arriving in s while executing o, [S, K] (Eq. 36).

    .. math::
      U[s, o] = (1 - \beta_o(s)) Q_O[s, o] + \beta_o(s) V[s]

    The same as V-bar[s, o] (Proposition D.1.4), by the termination functions instead of Eq. 22.
    """
    values = evaluate(model)
    terminate = as_float(model.termination).T
    return (1.0 - terminate) * values.q_option + terminate * values.v[:, None]
