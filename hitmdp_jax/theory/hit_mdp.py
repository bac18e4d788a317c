"""The Hidden Temporal MDP: its Bellman operator and its values, plain or soft (sec. 3.2, App. D).

Indices of the arrays: s in S, the previous option o_{t-1} in K_prev, the option o_t in K, the
action a in A. The augmented state is (s, o_{t-1}), the augmented action (o, a).
"""

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.model import OptionModel, as_float, markovian_master_policy


@struct.dataclass
class HiTMDP:
    """A finite HiT-MDP and its two policies, any of them, not only those of an SMDP (sec. 3.2).

    The last three fields make it the maximum-entropy one: the reward of a step is then the ELBO
    reward of Theorem 4.1, r + I + w_O H(pi_O) + w_A H(pi_A), entropies in nats. The paper's
    weights are 1; the plain HiT-MDP's are 0.
    """

    transition: jax.Array  # [S, A, S] P(s' | s, a); missing mass ends the episode
    reward: jax.Array  # [S, A] r(s, a)
    master: jax.Array  # [S, K_prev, K] P(o | s, o_prev) = pi_O
    action: jax.Array  # [K, S, A] P(a | s, o) = pi_A
    gamma: jax.Array | float
    information: jax.Array | float = 0.0  # I(o | s, a, o_prev), broadcasts to [S, K_prev, K, A]
    option_entropy: jax.Array | float = 0.0  # w_O
    action_entropy: jax.Array | float = 0.0  # w_A


@struct.dataclass
class HiddenValues:
    """The value functions of a HiT-MDP, which all take the hidden option."""

    v_bar: jax.Array  # [S, K_prev] the Markovian option-value function (Eq. 6)
    q_option: jax.Array  # [S, K] Q_O (Eq. 28)
    q_action: jax.Array  # [S, K, A] Q_A (Eq. 7)


def hit_mdp(model: OptionModel | HiTMDP) -> HiTMDP:
    """Return the HiT-MDP that is equivalent to the SMDP (Theorem 3.1); a HiT-MDP is its own."""
    if isinstance(model, HiTMDP):
        return model
    return HiTMDP(
        transition=as_float(model.transition),
        reward=as_float(model.reward),
        master=markovian_master_policy(model),
        action=as_float(model.action),
        gamma=as_float(model.gamma),
    )


def entropy(policy: jax.Array) -> jax.Array:
    """Return the entropy [...] in nats of the distributions policy [..., N].

    Its derivative at probability 0, where the true one is infinite, is 0.
    """
    return -(policy * jnp.log(jnp.where(policy > 0, policy, 1.0))).sum(-1)


def step_reward(hit: HiTMDP) -> jax.Array:
    """Return the ELBO reward of a step, r + I + w_O H(pi_O) + w_A H(pi_A), [S, K_prev, K, A]."""
    option_entropy = hit.option_entropy * entropy(hit.master)  # [S, K_prev]
    action_entropy = hit.action_entropy * entropy(hit.action).T  # [S, K]
    plain = hit.reward[:, None, None, :] + hit.information
    return plain + option_entropy[:, :, None, None] + action_entropy[:, None, :, None]


def augmented_reward(hit: HiTMDP) -> jax.Array:
    """Return the expected reward of a step from (s, o_{t-1}), [S, K_prev]."""
    nothing_after = jnp.zeros(hit.master.shape[:2], hit.master.dtype)
    return markovian_option_value(hit, option_action_value(hit, nothing_after))


def augmented_transition(hit: HiTMDP) -> jax.Array:
    """Return P(s_{t+1}, o_t | s_t, o_{t-1}), [S, K_prev, S, K]: the chain of augmented states."""
    return jnp.einsum("spo,osa,sat->spto", hit.master, hit.action, hit.transition)


def markovian_option_value(hit: HiTMDP, q_action: jax.Array) -> jax.Array:
    r"""Return V-bar[s, o_{t-1}], of shape [S, K_prev], given Q_A [S, K, A] (Eq. 6, soft).

    .. math::
      \bar V[s, o_{t-1}] = \sum_o \pi_O(o | s, o_{t-1}) \Big( Q_O[s, o]
        + \sum_a \pi_A(a | s, o) I(o | s, a, o_{t-1}) \Big) + w_O H(\pi_O(\cdot | s, o_{t-1}))

    I and H(pi_O) stand here, not in Q: they depend on o_{t-1}, which Q_O and Q_A do not know.
    """
    option = option_value(hit, q_action)[:, None] + expected_information(hit)
    return (hit.master * option).sum(-1) + hit.option_entropy * entropy(hit.master)


def option_value(hit: HiTMDP, q_action: jax.Array) -> jax.Array:
    """Return Q_O[s, o] = sum_a pi_A(a | s, o) Q_A[s, o, a] + w_A H(pi_A), [S, K] (Eq. 28)."""
    action_entropy = hit.action_entropy * entropy(hit.action).T
    return jnp.einsum("osa,soa->so", hit.action, q_action) + action_entropy


def expected_information(hit: HiTMDP) -> jax.Array:
    """Return I(o | s, o_{t-1}) = sum_a pi_A(a | s, o) I(o | s, a, o_{t-1}), [S, K_prev, K]."""
    shape = (*hit.master.shape, hit.reward.shape[-1])
    return jnp.einsum("osa,spoa->spo", hit.action, jnp.broadcast_to(hit.information, shape))


def option_action_value(hit: HiTMDP, v_bar: jax.Array) -> jax.Array:
    """Return r(s, a) + gamma sum_{s'} P(s' | s, a) V-bar[s', o], [S, K, A] (Eq. 8)."""
    return hit.reward[:, None] + hit.gamma * jnp.einsum("sat,to->soa", hit.transition, v_bar)


def hidden_temporal_operator(hit: HiTMDP, q_action: jax.Array) -> jax.Array:
    """Apply the Hidden Temporal Bellman operator T^H to Q_A [S, K, A] (Theorem 3.2, Eq. 8).

    T^H is a contraction by gamma in the sup norm (Theorem 3.3), whatever the rewards.
    """
    return option_action_value(hit, markovian_option_value(hit, q_action))


def hidden_values(hit: HiTMDP) -> HiddenValues:
    """Return the fixed point of T^H (Theorem 3.3), by one linear solve over augmented states."""
    reward = augmented_reward(hit)
    size = reward.size
    chain = augmented_transition(hit).reshape(size, size)
    identity = jnp.eye(size, dtype=chain.dtype)
    v_bar = jnp.linalg.solve(identity - hit.gamma * chain, reward.reshape(size))
    q_action = option_action_value(hit, v_bar.reshape(reward.shape))
    return HiddenValues(v_bar.reshape(reward.shape), option_value(hit, q_action), q_action)


def occupancy(hit: HiTMDP, start: jax.Array) -> jax.Array:
    r"""Return the discounted visits of the augmented states, [S, K_prev].

    .. math::
      d[s, o] = \sum_t \gamma^t P(s_t = s, o_{t-1} = o)

    from `start` [S, K_prev], the distribution of (s_0, o_{-1}). They sum to 1 / (1 - gamma) where
    no episode ends.
    """
    size = start.size
    chain = augmented_transition(hit).reshape(size, size)
    identity = jnp.eye(size, dtype=chain.dtype)
    visits = jnp.linalg.solve(identity - hit.gamma * chain.T, start.reshape(size))
    return visits.reshape(start.shape)


def objective(hit: HiTMDP, start: jax.Array) -> jax.Array:
    """Return the expected discounted return from `start` [S, K_prev], (s_0, o_{-1}); a scalar."""
    return (start * hidden_values(hit).v_bar).sum()
