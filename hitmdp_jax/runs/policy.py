"""`load`, which takes a trained policy out of a run's folder."""

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents import Agent
from hitmdp_jax.errors import UsageError, out_of_domain
from hitmdp_jax.learning.normalization import statistics_of
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.checkpoint_items import STATISTICS
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import is_policy
from hitmdp_jax.runs.policy_file import read_policy
from hitmdp_jax.training.policy import Policy
from hitmdp_jax.training.sweep import Training

__all__ = ["Policy", "load", "load_all", "places"]


def load(
    run_dir: str | Path,
    seed: int | None = None,
    checkpoint: int | str = "newest",
    setting: int = 0,
    task: int | None = None,
    trust: bool = False,
) -> Policy:
    """Load a policy of a run.

    Args:
      run_dir: the run's folder.
      seed: which of the run's seeds, by the number the run gave it; None takes the first.
      checkpoint: "newest"; "best", by the training return; or an iteration that was saved.
      setting: which setting of a sweep, by the number that its tables give it.
      task: of a transfer, the task whose newest or best checkpoint is asked for: 0 or 1. None takes
        the one that the newest checkpoint is of.
      trust: run the file of an own task or algorithm that the run names. It needs no such word
        where `save` or a command line of this user has named the file.

    Raises:
      UsageError: the folder holds no run, or no such checkpoint, seed or setting; or the run names
        a file that nobody here trusts.
    """
    run_dir = folder_of(run_dir)
    config = RunConfig.load(run_dir, trust)
    (place, *_) = places(config.trainings, config.seed if seed is None else seed, setting)
    _, everyone = load_all(run_dir, checkpoint, task)
    policy = jax.device_get(everyone).of(place)  # a device would compile a slice for each shape
    learned = jax.device_put((policy.params, policy.normalizer))
    return policy.replace(params=learned[0], normalizer=learned[1])


def places(
    trainings: Sequence[Training], seed: int | None = None, setting: int | None = None
) -> list[int]:
    """Return the places of those of a run's trainings of a seed and a setting; None takes all.

    Raises:
      UsageError: the run has no such seed or setting.
    """
    seeds, settings = ({getattr(t, name) for t in trainings} for name in ("seed", "setting"))
    for name, wanted, there in (("seed", seed, seeds), ("setting", setting, settings)):
        if wanted is not None and (not isinstance(wanted, int) or wanted not in there):
            raise UsageError(
                f"{name} = {wanted} is not in the run, which holds {min(there)} to {max(there)}."
            )
    return [
        i
        for i, training in enumerate(trainings)
        if seed in (None, training.seed) and setting in (None, training.setting)
    ]


def load_all(
    run_dir: str | Path, checkpoint: int | str = "newest", task: int | None = None
) -> tuple[int, Policy]:
    """Return a checkpoint's iteration and the policies of all trainings, their leaves [R, ...].

    Args and Raises as `load`.
    """
    run_dir = folder_of(run_dir)
    config = RunConfig.load(run_dir)
    if is_policy(run_dir):
        _, iteration, saved, spec = read_policy(run_dir)
        if checkpoint not in ("newest", "best", iteration):
            raise UsageError(f"'{run_dir}' holds no checkpoint {checkpoint}; it holds {iteration}.")
    else:
        with contextlib.closing(Checkpoints(run_dir, read_only=True)) as checkpoints:
            iteration, saved, spec = checkpoints.restore_policy(checkpoint, task)
    # How many observations the mean is of, older packages did not note.
    seen = jnp.full(len(config.trainings), iteration * config.num_envs * config.rollout_length)
    agents = config.agents.bind(spec)
    policy = acting(agents, {"count": seen} | saved)
    if not fits(policy, len(config.trainings)):
        raise UsageError(
            f"The checkpoint in '{run_dir}' does not fit the algorithm and seeds that its "
            "config.yaml names."
        )
    return iteration, policy


def acting(agent: Agent, saved: dict[str, Any]) -> Policy:
    """Return the policy of an agent, bound to its task, and of what a checkpoint keeps of it."""
    return Policy(agent, saved["params"], statistics_of(*(saved[x] for x in STATISTICS)))


def folder_of(run_dir: Any) -> Path:
    """Return a folder's path, or raise UsageError where there is none."""
    if not isinstance(run_dir, str | os.PathLike) or not str(run_dir):
        raise out_of_domain("run_dir", repr(run_dir), "the path of a run's folder")
    return Path(run_dir)


def fits(policy: Policy, trainings: int) -> bool:
    """Return whether the parameters [S, ...] are such as the agent makes; they may be anything."""

    def same_shapes(policy: Policy, key: jax.Array) -> bool:
        one = policy.of(0)
        one.act(jnp.zeros(one.spec.observation.shape), one.initial_memory(key), key)
        fresh = one.agent.init(key, one.spec).params
        shapes = [jax.tree.map(jnp.shape, tree) for tree in (one.params, fresh)]
        return shapes[0] == shapes[1]

    fits: list[bool] = []
    # Acting on parameters of another kind fails in as many ways as there are kinds.
    with contextlib.suppress(Exception):
        jax.eval_shape(lambda *args: fits.append(same_shapes(*args)), policy, jax.random.key(0))
    return fits == [True] and len(policy.normalizer.mean) == trainings
