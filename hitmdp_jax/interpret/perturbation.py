"""What each dimension of an option's embedding does to the actions (App. B.3, after capsules).

A dimension of W[o] is shifted by as much as embeddings differ and the option decoded again, in
states that the policy visited. (The paper shifts by a tenth at most, which moves nothing here.) The
shift is of W itself, which the action policy reads times `option_scale` and, with
`embeddings="equal"`, over sqrt(E): a unit of W is worth more where these are larger.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from hitmdp_jax.agents.hit_policy import HitPolicy
from hitmdp_jax.envs.spec import Discrete
from hitmdp_jax.interpret.interventions import IDENTICAL
from hitmdp_jax.networks.action_heads import noise_of, vector_of
from hitmdp_jax.runs.policy import Policy

# Of the entries of W when training begins; colours of W reach as far at least.
EMBEDDING_SCALE = 1.0
SHIFTS = 2 * EMBEDDING_SCALE * np.arange(-10, 11) / 10  # -2.0, -1.8, ..., 2.0
TINY = 1e-6  # of an action
# Standard deviations of an action that make two Gaussians practically identical.
NOTICED = (2 * IDENTICAL) ** 0.5


class Perturbation(NamedTuple):
    """What is done under shifted embeddings, mean over states.

    Of actions that are numbers this is the mean action, in each of A actuators. Of discrete actions
    it is the log-probability of each of A choices, whose `noise` is one nat.
    """

    shifts: np.ndarray  # [D]
    actions: np.ndarray  # [K, E, D, A] of option k with dimension e shifted
    slopes: np.ndarray  # [K, E, A] their derivative where nothing is shifted, per unit of W
    noise: np.ndarray  # [A] standard deviation of the policy's actions, mean over states
    choices: bool = False  # whether actions are discrete

    @property
    def moved(self) -> np.ndarray:
        """What the shifts change it by, [K, E, D, A]."""
        here = int(np.abs(self.shifts).argmin())
        return self.actions - self.actions[:, :, here : here + 1]

    @property
    def effects(self) -> np.ndarray:
        """The largest change by each dimension, in units of `noise`, [K, E]."""
        return (np.abs(self.moved) / np.maximum(self.noise, TINY)).max(axis=(2, 3))

    @property
    def negligible(self) -> bool:
        """Whether no shift makes a difference that can be noticed."""
        return bool(self.effects.max() < NOTICED)

    @property
    def summary(self) -> str:
        """A sentence on how much the shifts change."""
        most, by = self.effects.max(), np.abs(self.shifts).max()
        end = ": practically nothing." if self.negligible else "."
        plural = "log-probabilities" if self.choices else "mean actions"
        unit = "nats" if self.choices else "standard deviations of the policy's actions"
        return f"Shifts by up to {by:g} change {plural} by at most {most:.2g} {unit}{end}"

    @property
    def quantity(self) -> str:
        """What `actions` is, in words."""
        return "log-probability" if self.choices else "mean action"


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
    found = _perturbed(policy, jnp.asarray(obs), jnp.asarray(shifts))
    actions, slopes, noise = map(np.asarray, found)
    choices = isinstance(policy.spec.action, Discrete)
    return Perturbation(np.asarray(shifts), actions, slopes, noise, choices)


@jax.jit
def _perturbed(policy: Policy, obs: jax.Array, shifts: jax.Array) -> tuple[jax.Array, ...]:
    agent, params, states = policy.agent, policy.params, policy.normalized(obs)[:, None]
    num_options, width = params["embeddings"].shape

    def policies(rows: jax.Array) -> Any:
        """Return P(a | s, o) of all states and options [S, K] under embeddings [K, E]."""
        return agent.policy(params | {"embeddings": rows}, states, jnp.arange(num_options))

    def decode(rows: jax.Array) -> jax.Array:
        """Return what is done [K, A] under embeddings [K, E]."""
        return vector_of(policies(rows)).mean(axis=0)

    def along(dimension: jax.Array) -> jax.Array:
        moved = params["embeddings"] + shifts[:, None, None] * dimension  # [D, K, E]
        return jax.vmap(decode, out_axes=1)(moved)  # [K, D, A]

    # One dimension after the other: together they would be S K E D copies of the hidden layers.
    actions = jax.lax.map(along, jnp.eye(width))  # [E, K, D, A]
    # An option's actions depend on its own row alone.
    slopes = jnp.einsum("kake->kea", jax.jacrev(decode)(params["embeddings"]))
    noise = noise_of(policies(params["embeddings"]))
    return actions.swapaxes(0, 1), slopes, noise.reshape(-1, noise.shape[-1]).mean(axis=0)


def strongest(slopes: ArrayLike) -> np.ndarray:
    """Return the dimensions [..., E] of slopes [..., E, A], those that change most first.

    The order of slopes [E, A] is one option's; `np.abs(slopes).max(axis=0)` of [K, E, A] is that of
    all.
    """
    return np.argsort(-np.abs(slopes).max(axis=-1), axis=-1, kind="stable")


def sentences(
    found: Perturbation, option: int, actuators: Sequence[str], most: int = 3
) -> list[str]:
    """Say what the strongest dimensions of an option do: "dimension 17 moves bthigh by +0.31 ...".

    Of choices it is "dimension 17 changes the log-probability of north by +0.31 ...".

    Args:
      found: what shifts do.
      option: which.
      actuators: their names, or those of the choices, A.
      most: how many sentences. There are fewer where fewer dimensions do what can be noticed, and
        one that says so where none does.
    """
    slopes, said = found.slopes[option], []
    for dimension in strongest(slopes)[:most]:
        if found.effects[option, dimension] < NOTICED:
            continue
        actuator = int(np.abs(slopes[dimension]).argmax())
        by = slopes[dimension, actuator]
        does = f"changes the {found.quantity} of" if found.choices else "moves"
        said.append(f"dimension {dimension} {does} {actuators[actuator]} by {by:+.2g} per unit")
    does = "changes a choice" if found.choices else "moves an actuator"
    return said or [f"no dimension {does} noticeably"]
