"""Reading checkpoints, of which any file may be torn."""

import contextlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
import orbax.checkpoint as ocp

from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.runs.checkpoint_items import (
    POLICY,
    PROGRESS,
    STATE,
    WORDS,
    Progress,
    with_keys,
    with_raw_keys,
)
from hitmdp_jax.runs.checkpoint_words import (
    DamagedError,
    Words,
    best_of_each_task,
    check_fit,
    digest,
    noticing_damage,
)
from hitmdp_jax.training.state import TrainState


class SavedCheckpoints:
    """The checkpoints of one run that are there, for whoever reads them.

    Args:
      folder: where they lie.
      manager: Orbax's of that folder.
    """

    def __init__(self, folder: Path, manager: ocp.CheckpointManager):
        self.folder, self._manager = folder, manager

    def restore(self, like: Callable[[int], TrainState]) -> Progress:
        """Return the newest checkpoint that can be read, on the first device.

        One that cannot be read is told.

        Args:
          like: maps the number of a task to a state of the same shapes, abstract.

        Raises:
          UsageError: there is no checkpoint, or none fits the run.
        """

        def read(iteration: int) -> Progress:
            words = self._words(iteration)
            wanted = like(words.task)
            raw = self._read(iteration, STATE, jax.eval_shape(with_raw_keys, wanted))
            return Progress(iteration, words.task, with_keys(raw, wanted))

        return self._newest(read, self._written())

    def is_whole(self, iteration: int) -> bool:
        """Return whether a checkpoint holds what was saved, for all that a run goes on from.

        Raises:
          UsageError: a newer version of the package wrote it.
        """
        try:
            if STATE in self._words(iteration).digests:  # not of a policy alone
                self._read(iteration, STATE)
        except DamagedError:
            return False
        return True

    def restore_policy(
        self, which: int | str = "newest", task: int | None = None
    ) -> tuple[int, dict[str, Any], Spec]:
        """Return a checkpoint's iteration, `policy_of(state)` [R, ...] and the task's `Spec`.

        Args:
          which: "newest", "best" by its recent return, or the iteration of one.
          task: the place, from 0, of the task whose checkpoints count; returns of two tasks cannot
            be compared. None takes that of the newest one.

        Raises:
          UsageError: there is no such checkpoint, or it cannot be read.
        """

        def read(iteration: int) -> tuple[int, dict[str, Any], Spec]:
            policy = self._read(iteration, POLICY)
            return iteration, policy, self._words(iteration).spec

        steps = self._written()
        if task is not None:
            steps = [i for i, words in self._readable(steps).items() if words.task == task]
        if which == "newest":
            return self._newest(read, steps)
        iteration = self._best(steps) if which == "best" else which
        if not isinstance(iteration, int) or iteration not in steps:
            raise UsageError(
                f"'{self.folder}' holds no checkpoint {which}"
                f"{'' if task is None else f' of task {task}'}; it holds "
                f"{', '.join(map(str, steps)) or 'none'}, and 'newest' and 'best' name one of them."
            )
        try:
            return read(iteration)
        except DamagedError as damage:
            raise UsageError(f"{self._told(iteration, damage)}.") from None

    def restore_learned(self) -> tuple[int, dict[str, Any], Spec]:
        """Return the newest checkpoint's iteration, its arrays [R, ...] by name and the `Spec`.

        Returns what a training may begin with; Raises as `restore_policy`.
        """

        def read(iteration: int) -> tuple[int, dict[str, Any], Spec]:
            return iteration, self._read(iteration, STATE), self._words(iteration).spec

        return self._newest(read, self._written())

    def _written(self) -> list[int]:
        """Return the iterations whose checkpoints are there, the one under way among them."""
        self._manager.wait_until_finished()
        return list(self._manager.all_steps())

    def _newest(self, read: Callable[[int], Any], steps: Sequence[int]) -> Any:
        for iteration in sorted(steps, reverse=True):
            try:
                return read(iteration)
            except DamagedError as damage:
                warn(f"{self._told(iteration, damage)}; taking the one before.")
        if steps:
            raise UsageError(f"No checkpoint in '{self.folder}' can be read.")
        raise UsageError(f"'{self.folder}' holds no checkpoint.")

    def _told(self, iteration: int, damage: DamagedError) -> str:
        place = f"the checkpoint of iteration {iteration} in '{self.folder}'"
        return f"{place} cannot be read ({damage})"

    def _best(self, steps: Iterable[int]) -> int | None:
        """Return the best checkpoint of the newest one's task, the newest where no return is known.

        Those whose words cannot be read are out of the question.
        """
        known = self._readable(steps)
        if not known:
            return max(steps, default=None)
        return best_of_each_task(known.values())[known[max(known)].task]

    def _readable(self, steps: Iterable[int]) -> dict[int, Words]:
        """Return the words of those checkpoints whose words can be read."""
        found = {}
        for iteration in steps:
            with contextlib.suppress(DamagedError, UsageError):
                found[iteration] = self._words(iteration)
        return found

    @noticing_damage
    def _words(self, iteration: int) -> Words:
        return Words.read(self.folder / str(iteration) / PROGRESS / WORDS, iteration)

    @noticing_damage
    def _read(self, iteration: int, item: str, like: Any = None) -> Any:
        """Return an item's arrays as `like` has them, or as the checkpoint says that they are."""
        # Whatever devices wrote the checkpoint, it is read onto the first one of this machine.
        here = jax.sharding.SingleDeviceSharding(jax.local_devices()[0])
        found = self._manager.item_metadata(iteration)[item]
        claimed = getattr(found, "tree", found)
        target = jax.tree.map(
            lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=here),
            claimed if like is None else like,
        )
        check_fit(self.folder, claimed, target)
        arguments = {item: ocp.args.StandardRestore(target)}  # pyright: ignore[reportCallIssue]
        read = self._manager.restore(iteration, args=ocp.args.Composite(**arguments))[item]
        if self._words(iteration).digests.get(item) != digest(read):
            raise DamagedError("its numbers are not those that were saved")
        return read
