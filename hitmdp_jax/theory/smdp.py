"""The options as the SMDP has them: call, run, return (Sutton et al. 1999, sec. 3).

Nothing here knows of o_{t-1} or of the HiT-MDP: decisions happen only where an option terminates,
and an option is a black box with a return and a state it returns in. That these values are the
HiT-MDP's is the second half of Theorem 3.1 and Propositions D.1.1 to D.1.3.
"""

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.model import OptionModel, as_float, initiable_master_policy


@struct.dataclass
class MultiTimeModel:
    """What running each option until it terminates does (Sutton et al. 1999, Eq. 6-7)."""

    reward: jax.Array  # [K, S] discounted reward until termination
    transition: jax.Array  # [K, S, S] E[gamma^duration 1[it terminates in s']]


@struct.dataclass
class SMDPValues:
    """The value functions of the SMDP."""

    v: jax.Array  # [S] when the master policy picks an option
    q_option: jax.Array  # [S, K] when option o has been picked


def multi_time_model(model: OptionModel) -> MultiTimeModel:
    """Return the multi-time model of every option, by a linear solve for each."""
    action, transition = as_float(model.action), as_float(model.transition)
    terminate, gamma = as_float(model.termination), as_float(model.gamma)
    step = gamma * jnp.einsum("ksa,sat->kst", action, transition)
    reward = jnp.einsum("ksa,sa->ks", action, as_float(model.reward))
    identity = jnp.eye(step.shape[-1], dtype=step.dtype)
    still_running = identity - step * (1.0 - terminate)[:, None, :]
    arrive = step * terminate[:, None, :]
    solution = jnp.linalg.solve(still_running, jnp.concatenate([reward[:, :, None], arrive], -1))
    return MultiTimeModel(reward=solution[:, :, 0], transition=solution[:, :, 1:])


def evaluate_smdp(model: OptionModel) -> SMDPValues:
    """Return the values of the master policy over multi-time models, by one solve over states."""
    options, master = multi_time_model(model), initiable_master_policy(model)
    chain = jnp.einsum("sk,kst->st", master, options.transition)
    reward = jnp.einsum("sk,ks->s", master, options.reward)
    v = jnp.linalg.solve(jnp.eye(reward.size, dtype=chain.dtype) - chain, reward)
    return SMDPValues(v=v, q_option=(options.reward + options.transition @ v).T)
