"""`init_from=`: a run that begins with what another one, or a policy in a file, has learned."""

import contextlib
import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np

from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.normalization import statistics_of
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.checkpoint_items import STATISTICS
from hitmdp_jax.runs.folder import is_policy, require_run
from hitmdp_jax.runs.policy_file import PolicyFile, read_policy
from hitmdp_jax.training.state import TrainState
from hitmdp_jax.training.warm_start import Fit, Learned, begun, by_name, fit, sentence


@dataclasses.dataclass(frozen=True)
class Start:
    """What a run's trainings begin with.

    Attributes:
      path: where it was read.
      iteration: of the checkpoint.
      learned: its arrays [N, ...], of N trainings.
      fit: what of it fits the run.
    """

    path: Path
    iteration: int
    learned: Learned
    fit: Fit

    @property
    def number(self) -> int:
        """N, how many trainings there are to begin with."""
        return len(self.learned.leaves["normalizer/mean"])

    def of(self, places: np.ndarray) -> dict[str, jax.Array]:
        """Return the start of trainings [R]: training i takes that of source i, in a cycle."""
        leaves = self.learned.leaves
        return {name: leaves[name][places % self.number] for name in set(self.fit.taken.values())}

    def put(self, state: TrainState, leaves: dict[str, Any]) -> TrainState:
        """Return the trainings' state [R, ...] with what they begin with."""
        return begun(state, self.fit.taken, leaves)

    def told(self, state: TrainState) -> str:
        """Return a line that says what is taken over and what is new; `state`: one training's."""
        of = f"{self.number} trainings" if self.number > 1 else "the training"
        line = f"Begins with {of} in {self.path}, after iteration {self.iteration:,}"
        new = sentence(self.fit, self.learned.spec, state.spec)
        return f"{line}; {new}." if new else f"{line}."


def read_start(path: Path, state: TrainState, parts: tuple[str, ...]) -> Start:
    """Read what a run begins with: arrays alone, so that a stranger's runs no code.

    Args:
      path: a run's folder, or the file of a policy.
      state: the shapes of one training before its first iteration.
      parts: as `fit`.

    Raises:
      UsageError: there is nothing to read, or nothing of it fits.
    """
    require_run(path)
    if is_policy(path):
        iteration, learned = _of_file(read_policy(path))
    else:
        with contextlib.closing(Checkpoints(path, read_only=True)) as checkpoints:
            iteration, tree, spec = checkpoints.restore_learned()
        learned = Learned(by_name(tree), spec)
    shapes = {name: np.shape(x)[1:] for name, x in learned.leaves.items()}
    try:
        return Start(path, iteration, learned, fit(state, learned, shapes, parts))
    except UsageError as error:
        raise UsageError(str(error).replace("init_from:", f"init_from = {path}:", 1)) from None


def _of_file(file: PolicyFile) -> tuple[int, Learned]:
    """Return the content of a policy's file; it never has an optimiser."""
    known = file.learned
    # How many observations the mean is of, older packages did not note.
    steps = file.settings.get("num_envs", 16) * file.settings.get("rollout_length", 128)
    count = known.get("count", np.full(len(known["mean"]), file.iteration * steps))
    statistics = statistics_of(*(({"count": count} | known)[name] for name in STATISTICS))
    tree = {"learner": {"params": known["params"]}, "normalizer": statistics}
    return file.iteration, Learned(by_name(tree), file.spec)
