"""What knowing o_{t-1} does to the mean and the variance of the return (Prop. 3.4 and 3.5)."""

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.hit_mdp import HiTMDP, augmented_transition, hidden_values, step_reward


@struct.dataclass
class VarianceDecomposition:
    """The law of total variance for the return from s, o_{t-1} drawn from P(o_{t-1} | s)."""

    total: jax.Array  # [S] Var(G | s), the mean squared error of V[s]
    within: jax.Array  # [S] E[Var(G | s, o_{t-1}) | s], the mean squared error of V-bar
    between: jax.Array  # [S] Var(V-bar[s, o_{t-1}] | s)


def visits(hit: HiTMDP, start: jax.Array, time: int) -> jax.Array:
    """Return the distribution [S, K_prev] of (s_t, o_{t-1}) at t = `time`.

    Args:
      hit: the HiT-MDP.
      start: [S, K_prev] distribution of (s_0, o_{-1}).
      time: t, 0 or more.
    """
    chain = augmented_transition(hit)
    return jax.lax.fori_loop(0, time, lambda _, d: jnp.einsum("sp,spto->to", d, chain), start)


def previous_option_belief(weights: jax.Array) -> jax.Array:
    """Return P(o_{t-1} | s) [S, K_prev] from visits to (s, o_{t-1}), [S, K_prev].

    The visits may be those of one time step (`visits`) or discounted over all (`occupancy`). The
    belief in a state that is never visited is uniform.
    """
    total = weights.sum(-1, keepdims=True)
    return jnp.where(total > 0, weights / jnp.where(total > 0, total, 1.0), 1.0 / weights.shape[-1])


def expected_value(v_bar: jax.Array, belief: jax.Array) -> jax.Array:
    r"""Return E[V-bar[s, o_{t-1}] | s], of shape [S]: the right-hand side of Proposition 3.4.

    .. math::
      E[G_t | s_t = s] = \sum_{o} P(o_{t-1} = o | s_t = s) \bar V[s, o]

    True for this V[s], the mean return over visits to s, which depends on how s is reached. The
    V[s] of Eq. 27 with the SMDP master policy is another number: see docs/errata.md.
    """
    return (belief * v_bar).sum(-1)


def return_second_moment(hit: HiTMDP) -> jax.Array:
    r"""Return E[G^2 | s, o_{t-1}], of shape [S, K_prev], by a linear solve.

    .. math::
      E[G^2] = E[\rho^2] + 2 \gamma E[\rho \bar V'] + \gamma^2 E[G'^2]

    where rho is the reward of the step, taken as deterministic given (s, o_{t-1}, o, a).
    """
    reward, v_bar = step_reward(hit), hidden_values(hit).v_bar
    next_value = jnp.einsum("sat,to->soa", hit.transition, v_bar)[:, None]
    now = jnp.square(reward) + 2.0 * hit.gamma * reward * next_value
    now = jnp.einsum("spo,osa,spoa->sp", hit.master, hit.action, now)
    chain = augmented_transition(hit).reshape(now.size, now.size)
    identity = jnp.eye(now.size, dtype=chain.dtype)
    return jnp.linalg.solve(identity - hit.gamma**2 * chain, now.ravel()).reshape(now.shape)


def variance_decomposition(hit: HiTMDP, belief: jax.Array) -> VarianceDecomposition:
    r"""Split the variance of the return by what o_{t-1} explains (Proposition 3.5, corrected).

    .. math::
      Var(G | s) = E[Var(G | s, o_{t-1}) | s] + Var(\bar V[s, o_{t-1}] | s)

    So the return scatters no more around V-bar than around V, and strictly less where V-bar differs
    between previous options that both occur in s. The printed inequality, Var(V-bar) <= Var(V), is
    the wrong way round: V[s] is the mean of V-bar, hence varies less.

    Args:
      hit: the HiT-MDP.
      belief: [S, K_prev] P(o_{t-1} | s).
    """
    v_bar, second = hidden_values(hit).v_bar, return_second_moment(hit)
    mean = expected_value(v_bar, belief)
    return VarianceDecomposition(
        total=(belief * second).sum(-1) - jnp.square(mean),
        within=(belief * (second - jnp.square(v_bar))).sum(-1),
        between=(belief * jnp.square(v_bar - mean[:, None])).sum(-1),
    )
