"""What each dimension of an option's embedding does to the actions (App. B.3, after capsules).

A dimension of W[o] is shifted a little and the option decoded again, in states that the policy
visited. The shift is of W itself, which the action policy reads times `option_scale` and, with
`embeddings="equal"`, over sqrt(E): a unit of W is worth more where these are larger.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hitmdp_jax.agents.hit_policy import HitPolicy
from hitmdp_jax.training.policy import Policy

SHIFTS = np.arange(-10, 10) / 100  # -0.10, -0.09, ..., 0.09, as printed


class Perturbation(NamedTuple):
    """Mean actions over states, under shifted embeddings."""

    shifts: np.ndarray  # [D]
    actions: np.ndarray  # [K, E, D, A] of option k with dimension e shifted
    slopes: np.ndarray  # [K, E, A] their derivative where nothing is shifted, a unit of W


def embeddings(policy: Policy) -> np.ndarray | None:
    """Return W [K, E]; None where options are no embeddings."""
    return np.asarray(policy.params["embeddings"]) if isinstance(policy.agent, HitPolicy) else None


def perturb(policy: Policy, obs: ArrayLike, shifts: ArrayLike = SHIFTS) -> Perturbation | None:
    """Shift every dimension of every option; None where options are no embeddings.

    Args:
      policy: what decodes options into actions.
      obs: the states, raw observations [S, O].
      shifts: [D].
    """
    if embeddings(policy) is None:
        return None
    actions, slopes = _perturbed(policy, jnp.asarray(obs), jnp.asarray(shifts))
    return Perturbation(np.asarray(shifts), np.asarray(actions), np.asarray(slopes))


@jax.jit
def _perturbed(policy: Policy, obs: jax.Array, shifts: jax.Array) -> tuple[jax.Array, jax.Array]:
    agent, params, states = policy.agent, policy.params, policy.normalized(obs)[:, None]
    num_options, width = params["embeddings"].shape

    def decode(rows: jax.Array) -> jax.Array:
        """Return the mean actions [K, A] under embeddings [K, E]."""
        every = jnp.arange(num_options)
        policies = agent.policy(params | {"embeddings": rows}, states, every)
        return policies.mean().mean(axis=0)

    def along(dimension: jax.Array) -> jax.Array:
        moved = params["embeddings"] + shifts[:, None, None] * dimension  # [D, K, E]
        return jax.vmap(decode, out_axes=1)(moved)  # [K, D, A]

    # One dimension after the other: together they would be S K E D copies of the hidden layers.
    actions = jax.lax.map(along, jnp.eye(width))  # [E, K, D, A]
    # An option's actions depend on its own row alone.
    slopes = jnp.einsum("kake->kea", jax.jacrev(decode)(params["embeddings"]))
    return actions.swapaxes(0, 1), slopes


def strongest(slopes: ArrayLike) -> np.ndarray:
    """Return the dimensions [..., E] of slopes [..., E, A], those that move an actuator most first.

    The order of slopes [E, A] is one option's; `np.abs(slopes).max(axis=0)` of [K, E, A] is that of
    all.
    """
    return np.argsort(-np.abs(slopes).max(axis=-1), axis=-1, kind="stable")


def sentences(slopes: ArrayLike, actuators: Sequence[str], most: int = 3) -> list[str]:
    """Say what the strongest dimensions of an option do: "dimension 17 moves bthigh by +0.31 ...".

    Args:
      slopes: [E, A] of one option.
      actuators: their names, A.
      most: how many sentences.
    """
    slopes = np.asarray(slopes)
    said = []
    for dimension in strongest(slopes)[:most]:
        actuator = int(np.abs(slopes[dimension]).argmax())
        by = slopes[dimension, actuator]
        said.append(f"dimension {dimension} moves {actuators[actuator]} by {by:+.2g} a unit")
    return said
