"""The guard against divergence: a run that is no longer finite keeps what it had learned."""

from typing import Any

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from hitmdp_jax.metrics import Metrics, describe
from hitmdp_jax.training.state import TrainState

# What was not finite where a seed diverged. Checkpoints hold the place: new ones go to the end.
CAUSES = (
    "none", "reward", "loss", "parameters", "observation", "observation statistics", "policy"
)  # fmt: skip


def watched(learning: Metrics, cause: str) -> list[jax.Array]:
    """Return those of an algorithm's metrics of which one that is not finite has that cause."""
    return [x for name, x in sorted(learning.items()) if describe(name).cause == cause]


def freeze_diverged(
    old: TrainState, new: TrainState, metrics: Metrics, seen: dict[str, Any]
) -> tuple[TrainState, Metrics]:
    """Keep what a run had learned when it is no longer finite; its metrics are NaN from then on.

    A NaN would stay in the parameters or the normaliser for ever, and take what was learned with
    it. The replay is large and is left alone: nothing is learned from it any more. Nothing is
    shared between the runs of a sweep, so the others go on as they would alone.

    Args:
      old: the state before the iteration.
      new: the state after it.
      metrics: the iteration's.
      seen: what must be finite, by its name in `CAUSES`; of several the first is the cause.
    """
    finite = jnp.stack([jnp.isfinite(ravel_pytree(part)[0]).all() for part in seen.values()])
    lost = (old.diverged > 0) | ~finite.all()
    first = (old.diverged == 0) & ~finite.all()
    causes = jnp.array([CAUSES.index(name) for name in seen], jnp.int32)

    def keep(before: Any, after: Any) -> Any:
        return jax.tree.map(lambda a, b: jnp.where(lost, a, b), before, after)

    state = new.replace(
        learner=keep(old.learner, new.learner),
        normalizer=keep(old.normalizer, new.normalizer),
        diverged=jnp.where(first, new.iteration, old.diverged),
        cause=jnp.where(first, causes[jnp.argmin(finite)], old.cause),
    )

    def nothing(name: str, x: jax.Array) -> jax.Array:
        return jnp.zeros_like(x) if describe(name).over_iterations == "sum" else x * jnp.nan

    told = {name: jnp.where(lost, nothing(name, x), x) for name, x in metrics.items()}
    return state, told | {"diverged": lost}
