"""What a checkpoint consists of: the whole state, what acting needs of it, and a few words."""

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from brax.training.acme.running_statistics import RunningStatisticsState

from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.learning.normalization import count_of
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint_words import Words, digest
from hitmdp_jax.training.state import TrainState

STATE, POLICY, PROGRESS = "state", "policy", "progress"
STATISTICS = "mean", "std", "count"  # of the normaliser, as `statistics_of` takes them
WORDS = "metadata"  # the file of the last one
HANDLERS = {
    STATE: ocp.StandardCheckpointHandler,
    POLICY: ocp.StandardCheckpointHandler,
    PROGRESS: lambda: ocp.JsonCheckpointHandler(WORDS),
}


@dataclasses.dataclass
class Progress:
    """How far a run has come: what a checkpoint holds and a loop moves on."""

    iteration: int  # iterations done, over all tasks
    task: int  # the place of the task that the state belongs to, from 0
    state: TrainState | None  # [S, ...]; None before the first iteration
    report: Metrics = dataclasses.field(default_factory=dict)  # what hooks are told beside it


def items_of(
    trees: dict[str, Any], spec: Spec, task: int, iteration: int, recent_return: float
) -> ocp.args.Composite:
    """Return the items of a checkpoint in the form that Orbax takes."""
    digests = {item: digest(tree) for item, tree in trees.items()}
    known = None if math.isnan(recent_return) else recent_return
    words = Words(task, iteration, known, spec, digests).to_dict()
    arrays = {item: ocp.args.StandardSave(_savable(tree)) for item, tree in trees.items()}  # pyright: ignore
    return ocp.args.Composite(**arrays, **{PROGRESS: ocp.args.JsonSave(words)})  # pyright: ignore


def policy_of(state: TrainState) -> dict[str, Any]:
    """Return the parts of a state that acting and resuming need: parameters and `STATISTICS`."""
    return kept_of(state.learner.params, state.normalizer)


def kept_of(params: Any, normalizer: RunningStatisticsState) -> dict[str, Any]:
    """Return the parts of a policy that are kept."""
    statistics = normalizer.mean, normalizer.std, count_of(normalizer)
    return {"params": params} | dict(zip(STATISTICS, statistics, strict=True))


def with_raw_keys(state: TrainState) -> TrainState:
    """Return a state whose keys are raw numbers, as a checkpoint holds them: a task's own, too.

    Orbax saves no array without entries, which the states of simulators contain: in place of one is
    an array of zeros that has some.
    """

    def raw(x: Any) -> Any:
        if _is_key(x):
            return jax.random.key_data(x)
        return x if x.size else jnp.zeros([size or 1 for size in x.shape], x.dtype)

    return jax.tree.map(raw, state)


def with_keys(raw: TrainState, like: TrainState) -> TrainState:
    """Return a state with keys and arrays without entries where `like`, alike, has them."""

    def back(x: Any, y: Any) -> Any:
        if _is_key(y):
            return jax.random.wrap_key_data(x)
        return x if y.size else jnp.zeros(y.shape, y.dtype)

    return jax.tree.map(back, raw, like)


def _is_key(x: Any) -> bool:
    return jnp.issubdtype(x.dtype, jax.dtypes.prng_key)


def _savable(tree: Any) -> Any:
    """Return arrays as Orbax takes them: of one of several processes in NumPy, by name.

    Of JAX's own it wants the parts that every process has; and Brax's counter is JAX's in whatever
    it is put back together from.
    """
    if not processes.several():
        return tree
    return jax.tree.map(np.asarray, ocp.tree.serialize_tree(tree, keep_empty_nodes=True))
