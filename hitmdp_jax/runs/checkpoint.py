"""Saving and restoring training states with Orbax."""

import math
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
import orbax.checkpoint as ocp
from orbax.checkpoint import checkpoint_managers as managers

from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.reading import check_tree
from hitmdp_jax.runs.checkpoint_items import (
    HANDLERS,
    POLICY,
    STATE,
    Progress,
    items_of,
    policy_of,
    with_raw_keys,
)
from hitmdp_jax.runs.checkpoint_reading import SavedCheckpoints
from hitmdp_jax.runs.checkpoint_words import Words, best_of_each_task
from hitmdp_jax.runs.folder import CHECKPOINTS, refuse_link, subfolder
from hitmdp_jax.training.state import TrainState

KEPT = 3  # the newest checkpoints; the best one is kept beside them
MARGIN = 2**20  # bytes of a checkpoint beside its arrays, at most, and of metrics meanwhile
INTERVAL = 120.0  # seconds after which a run saves, however few steps it made


class Checkpoints(SavedCheckpoints):
    """The checkpoints of one run, numbered by iteration: the newest three, and each task's best.

    A checkpoint holds the whole training state, for exact resuming; beside it what acting needs
    (parameters and normaliser), which stays readable when a task's internals change; and a few
    words of JSON, digests of all the rest among them, by which damage is noticed. All of it is
    arrays and text: reading a stranger's checkpoint runs no code.
    Saving copies first and writes in the background, under a name that no reader takes for a
    checkpoint until it is whole.

    Args:
      run_dir: the run's folder; checkpoints lie in its `checkpoints/`.
      read_only: leave the folder as it is.

    Raises:
      UsageError: there is nothing to read, or what may never end (`check_tree`).
      OSError: a link is in the place of what is to be written.
    """

    def __init__(self, run_dir: Path, read_only: bool = False):
        self.folder = (run_dir / CHECKPOINTS).absolute()
        here = jax.process_index()  # which alone reads and writes, however many train together
        options = ocp.CheckpointManagerOptions(
            preservation_policy=managers.AnyPreservationPolicy(
                [managers.LatestN(KEPT), _BestOfEachTask(self._readable)]
            ),
            create=False,  # Orbax's own read_only warns at every reading
            multiprocessing_options=ocp.options.MultiprocessingOptions(here, {here}, "alone"),
        )
        if not read_only:
            for path in subfolder(run_dir, CHECKPOINTS).rglob("*"):
                refuse_link(path)  # Orbax would write through it
        if read_only and not self.folder.is_dir():
            raise UsageError(f"'{self.folder}' holds no checkpoint.")
        check_tree(self.folder)
        handlers = {item: handler() for item, handler in HANDLERS.items()}
        manager = ocp.CheckpointManager(self.folder, options=options, item_handlers=handlers)
        super().__init__(self.folder, manager)
        self._last_save = time.monotonic()
        self._wanted = -1  # the iteration that was saved last, or should have been
        self.failure: str | None = None  # why the newest state is not saved

    def due(self) -> bool:
        """Return whether so much time has passed that the run should save."""
        return time.monotonic() - self._last_save > INTERVAL

    def save(self, progress: Progress, recent_return: float = math.nan) -> None:
        """Save a state, unless that is done already.

        A disk that is full is told once and ends nothing: the checkpoints before stay as they are.

        Args:
          progress: where the run stands.
          recent_return: what the best checkpoint is best in.
        """
        state, iteration = progress.state, progress.iteration
        assert state is not None
        if iteration in self._manager.all_steps():
            return
        trees = {STATE: with_raw_keys(state), POLICY: policy_of(state)}
        items = items_of(trees, state.spec, progress.task, iteration, recent_return)
        self._last_save, self._wanted = time.monotonic(), iteration

        def write() -> None:
            # Orbax's own threads report a disk that fills up under them in hundreds of lines.
            needed = 2 * _size(state) + MARGIN
            free = shutil.disk_usage(self.folder).free
            if free < needed:
                raise OSError(f"no space left: {free:,} bytes are free, {needed:,} are needed")
            self._manager.save(iteration, args=items)

        self._attempt(write)

    def restore(self, like: Callable[[int], TrainState]) -> Progress:
        """Return the newest checkpoint that can be read, and remove those that cannot.

        So they can be written again. Args and Raises as `SavedCheckpoints.restore`.
        """
        progress = super().restore(like)
        for iteration in self._manager.all_steps():
            if iteration > progress.iteration:
                self._manager.delete(iteration)
        return progress

    def close(self) -> None:
        """Wait until everything is written."""
        self._attempt(self._manager.wait_until_finished)
        if (self.folder / str(self._wanted)).is_dir():
            self.failure = None  # what failed before has been made up for
        elif self._wanted >= 0 and self.failure is None:
            self.failure = f"'{self.folder}' has been moved or removed."
        self._attempt(self._manager.close)

    def _attempt(self, action: Callable[[], Any]) -> None:
        try:
            action()
        except Exception as error:  # Orbax and TensorStore raise many kinds where a disk is full
            reason = str(error).strip().splitlines() or [type(error).__name__]
            if self.failure is None:
                warn(f"a checkpoint could not be written: {reason[0]}")
            self.failure = reason[0]


def saved_iterations(run_dir: Path) -> list[int]:
    """Return the iterations whose checkpoints a run's folder holds, without reading them."""
    folder = run_dir / CHECKPOINTS
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    return sorted(int(name) for name in names if name.isdecimal())


def _size(state: TrainState) -> int:
    return sum(x.nbytes for x in jax.tree.leaves(with_raw_keys(state)))


class _BestOfEachTask(managers.PreservationPolicy):
    """Keeps the checkpoint of each task whose recent return is the highest.

    Orbax's own `BestN` forgets the returns of a run that is gone on with.

    Args:
      readable: returns the words of those checkpoints whose words can be read: not of the one that
        is being written.
    """

    def __init__(self, readable: Callable[[Iterable[int]], dict[int, Words]]):
        self._readable = readable

    def should_preserve(
        self, checkpoints: Sequence[Any], *, context: managers.PreservationContext
    ) -> Sequence[bool]:
        """Return for each checkpoint whether it is the best of its task."""
        steps = [checkpoint.step for checkpoint in checkpoints]
        best = best_of_each_task(self._readable(steps).values())
        return [step in best.values() for step in steps]
