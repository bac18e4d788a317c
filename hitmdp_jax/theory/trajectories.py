"""Trajectory probabilities under the SMDP and under the HiT-MDP (Theorem 3.1, App. C).

A trajectory of T steps is s_0, o_0, a_0, ..., s_{T-1}, o_{T-1}, a_{T-1}. The SMDP's options are
indices, the HiT-MDP's are one-hot vectors, and `partition` is the map B-bar between the two.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct

from hitmdp_jax.theory.hit_mdp import HiTMDP
from hitmdp_jax.theory.model import (
    OptionModel,
    as_float,
    initiable_master_policy,
    mixture_master_policy,
)


@struct.dataclass
class Trajectory:
    """Trajectories of the SMDP, tau; any leading batch shape."""

    state: jax.Array  # [..., T] int
    option: jax.Array  # [..., T] int
    action: jax.Array  # [..., T] int


@struct.dataclass
class HiddenTrajectory:
    """Trajectories of the HiT-MDP, tau-bar; any leading batch shape."""

    state: jax.Array  # [..., T] int
    option: jax.Array  # [..., T, K] one-hot
    action: jax.Array  # [..., T] int


def enumerate_trajectories(
    num_states: int, num_options: int, num_actions: int, length: int
) -> Trajectory:
    """Return all (S K A)^T trajectories of T = `length` steps, the batch axis first."""
    steps = list(itertools.product(range(num_states), range(num_options), range(num_actions)))
    every = np.array(list(itertools.product(steps, repeat=length)), np.int32)  # [N, T, 3]
    return Trajectory(*(jnp.asarray(every[..., i]) for i in range(3)))


def partition(trajectory: HiddenTrajectory) -> Trajectory:
    """Map tau-bar to tau: B-bar = (f, id, id, f) with f(o-bar) = o-bar . d (App. C.3).

    d is (0, ..., K-1) here, as options are numbered from 0.
    """
    weights = jnp.arange(trajectory.option.shape[-1])
    option = jnp.round(trajectory.option @ weights.astype(trajectory.option.dtype))
    return Trajectory(trajectory.state, option.astype(jnp.int32), trajectory.action)


def one_hot(trajectory: Trajectory, num_options: int) -> HiddenTrajectory:
    """Return the only trajectory of one-hot vectors that `partition` maps to this one."""
    option = jax.nn.one_hot(trajectory.option, num_options, dtype=jnp.result_type(float))
    return HiddenTrajectory(trajectory.state, option, trajectory.action)


def mixture(probabilities: jax.Array, option: jax.Array) -> jax.Array:
    """Return prod_k P_k ^ o_k for probabilities [..., K] and one-hot options [..., K] (Eq. 2)."""
    return jnp.prod(probabilities**option, axis=-1)


def smdp_probability(model: OptionModel, first: jax.Array, trajectory: Trajectory) -> jax.Array:
    r"""Return the probability of each trajectory under the SMDP, [...] (Eq. 1, 16).

    .. math::
      P(\tau) = P(s_0, o_0) P_{o_0}(a_0 | s_0) \prod_{t \ge 1} P(s_t | s_{t-1}, a_{t-1})
        P_{o_t}(a_t | s_t) [(1 - \beta_{o_{t-1}}(s_t)) 1_{o_t = o_{t-1}}
        + \beta_{o_{t-1}}(s_t) P(o_t | s_t)]

    Args:
      model: the option framework.
      first: [S, K] joint distribution of the first state and the first option executed.
      trajectory: tau, T steps.
    """
    state, option = trajectory.state, trajectory.option
    before, now = option[..., :-1], option[..., 1:]
    terminate = as_float(model.termination)[before, state[..., 1:]]
    pick = initiable_master_policy(model)[state[..., 1:], now]
    choice = (1.0 - terminate) * (before == now) + terminate * pick
    return _without_options(model, first, trajectory) * choice.prod(-1)


def call_and_return_probability(
    model: OptionModel, first: jax.Array, trajectory: Trajectory, terminated: jax.Array
) -> jax.Array:
    """Return the joint probability of each trajectory and of where options terminated (Eq. 24).

    Args:
      model: the option framework.
      first: [S, K] joint distribution of the first state and the first option executed.
      trajectory: tau, T steps.
      terminated: [..., T - 1] int, b_1 to b_{T-1}: whether o_{t-1} terminated on arriving in s_t.
    """
    state, option = trajectory.state[..., 1:], trajectory.option
    before, now = option[..., :-1], option[..., 1:]
    terminate = as_float(model.termination)[before, state]
    termination = jnp.where(terminated == 1, terminate, 1.0 - terminate)
    choice = mixture_master_policy(model)[terminated, state, before, now]
    return _without_options(model, first, trajectory) * (termination * choice).prod(-1)


def hit_mdp_probability(hit: HiTMDP, first: jax.Array, trajectory: HiddenTrajectory) -> jax.Array:
    r"""Return the probability of each trajectory under the HiT-MDP, [...] (Eq. 5, 26).

    .. math::
      P(\bar\tau) = P(s_0, \bar o_0) P(a_0 | s_0, \bar o_0) \prod_{t \ge 1}
        P(s_t | s_{t-1}, a_{t-1}) P(\bar o_t | s_t, \bar o_{t-1}) P(a_t | s_t, \bar o_t)

    `first` [S, K] is the joint distribution of the first state and the first option executed;
    `first_option` gives it from that of (s_0, o_{-1}), with which Eq. 26 begins.
    """
    state, option, action = trajectory.state, trajectory.option, trajectory.action
    num_options = option.shape[-1]
    intra_option = jnp.moveaxis(hit.action, 0, -1)  # [S, A, K]
    acting = mixture(intra_option[state, action], option).prod(-1)
    moving = hit.transition[state[..., :-1], action[..., :-1], state[..., 1:]].prod(-1)
    pairs = option[..., :-1, :, None] * option[..., 1:, None, :]
    shape = (*pairs.shape[:-2], num_options * num_options)
    choosing = mixture(hit.master[state[..., 1:]].reshape(shape), pairs.reshape(shape)).prod(-1)
    return mixture(first[state[..., 0]], option[..., 0, :]) * acting * moving * choosing


def first_option(hit: HiTMDP, start: jax.Array) -> jax.Array:
    """Return the distribution [S, K] of (s_0, o_0) from `start` [S, K_prev], of (s_0, o_{-1})."""
    return jnp.einsum("sp,spo->so", start, hit.master)


def discounted_return(
    reward: jax.Array, gamma: jax.Array | float, trajectory: Trajectory | HiddenTrajectory
) -> jax.Array:
    """Return sum_t gamma^t r(s_t, a_t) over the T steps, [...], for reward [S, A]."""
    discount = gamma ** jnp.arange(trajectory.state.shape[-1])
    return (discount * reward[trajectory.state, trajectory.action]).sum(-1)


def _without_options(model: OptionModel, first: jax.Array, trajectory: Trajectory) -> jax.Array:
    """Return the factors of P(tau) that Eq. 16 and Eq. 24 share: start, actions, transitions."""
    state, option, action = trajectory.state, trajectory.option, trajectory.action
    acting = as_float(model.action)[option, state, action].prod(-1)
    moving = as_float(model.transition)[state[..., :-1], action[..., :-1], state[..., 1:]]
    return first[state[..., 0], option[..., 0]] * acting * moving.prod(-1)
