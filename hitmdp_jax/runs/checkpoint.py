"""Saving and restoring training states with Orbax."""

import contextlib
import dataclasses
import hashlib
import json
import math
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp
from brax.training.acme.running_statistics import NestedMeanStd
from orbax.checkpoint import checkpoint_managers as managers

from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.reading import check_tree
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.folder import CHECKPOINTS, refuse_link, subfolder
from hitmdp_jax.training.program import TrainState

SCHEMA = 1  # of a checkpoint; raised where an older package would misread it
STATE, POLICY, PROGRESS = "state", "policy", "progress"  # the items of a checkpoint
WORDS = "metadata"  # the file of the last one
BEFORE_DIGESTS = {"schema", "task", "iteration", "recent_return"}  # all the words there were then
KEPT = 3  # the newest checkpoints; the best one is kept beside them
MARGIN = 2**20  # bytes of a checkpoint beside its arrays, at most, and of metrics meanwhile
INTERVAL = 120.0  # seconds after which a run saves, however few steps it made


@dataclasses.dataclass
class Progress:
    """How far a run has come: what a checkpoint holds and a loop moves on."""

    iteration: int  # iterations done, over all tasks
    task: int  # the place of the task that the state belongs to, from 0
    state: TrainState | None  # [S, ...]; None before the first iteration


class DamagedError(Exception):
    """A checkpoint is not what was saved."""


class Checkpoints:
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
                [managers.LatestN(KEPT), _BestOfEachTask(self._words)]
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
        handlers = {
            STATE: ocp.StandardCheckpointHandler(),
            POLICY: ocp.StandardCheckpointHandler(),
            PROGRESS: ocp.JsonCheckpointHandler(WORDS),
        }
        self._manager = ocp.CheckpointManager(self.folder, options=options, item_handlers=handlers)
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
        policy = policy_of(state)
        if iteration in self._manager.all_steps():
            return
        trees = {STATE: with_raw_keys(state), POLICY: policy}
        items = _items(trees, state.spec, progress.task, iteration, recent_return)
        self._last_save, self._wanted = time.monotonic(), iteration

        def write() -> None:
            # Orbax's own threads report a disk that fills up under them in hundreds of lines.
            needed = 2 * _size(state) + MARGIN
            free = shutil.disk_usage(self.folder).free
            if free < needed:
                raise OSError(f"no space left: {free:,} bytes are free, {needed:,} are needed")
            self._manager.save(iteration, args=items)

        self._attempt(write)

    def save_policy(self, iteration: int, task: int, policy: dict[str, Any], spec: Spec) -> None:
        """Save what acting needs, without the state that a training would go on from.

        Args:
          iteration: after which the policy acted so.
          task: the place of the task that it had learned then.
          policy: as `restore_policy` gives it.
          spec: what that task says of itself.
        """
        items = _items({POLICY: policy}, spec, task, iteration, math.nan)
        self._attempt(lambda: self._manager.save(iteration, args=items))

    def restore(self, like: Callable[[int], TrainState]) -> Progress:
        """Return the newest checkpoint that can be read, on the first device.

        One that cannot be read is told, and removed so that it can be written again.

        Args:
          like: maps the number of a task to a state of the same shapes, abstract.

        Raises:
          UsageError: there is no checkpoint, or none fits the run.
        """

        def read(iteration: int) -> Progress:
            words = self._words(iteration)
            raw = self._read(iteration, STATE, jax.eval_shape(with_raw_keys, like(words["task"])))
            state = raw.replace(key=jax.random.wrap_key_data(raw.key))
            return Progress(iteration, words["task"], state)

        progress = self._newest(read, self._written())
        for iteration in self._manager.all_steps():
            if iteration > progress.iteration:
                self._manager.delete(iteration)
        return progress

    def is_whole(self, iteration: int) -> bool:
        """Return whether a checkpoint holds what was saved, for all that a run goes on from.

        Raises:
          UsageError: a newer version of the package wrote it.
        """
        try:
            if STATE in self._words(iteration).get("digests", {STATE}):  # not of a policy alone
                self._read(iteration, STATE, self._claimed(iteration, STATE))
        except UsageError:
            raise
        except Exception:  # whatever a torn file makes its reader say
            return False
        return True

    def restore_policy(
        self, which: int | str = "newest", task: int | None = None
    ) -> tuple[int, dict[str, Any], Spec | None]:
        """Return a checkpoint's iteration, `policy_of(state)` and the task's specification.

        Parameters and normaliser are [S, ...]. The specification is None in older checkpoints.

        Args:
          which: "newest", "best" by its recent return, or the iteration of one.
          task: the place, from 0, of the task whose checkpoints count; returns of two tasks cannot
            be compared. None takes that of the newest one.

        Raises:
          UsageError: there is no such checkpoint, or it cannot be read.
        """

        def read(iteration: int) -> tuple[int, dict[str, Any], Spec | None]:
            known = self._words(iteration).get("spec")
            spec = None if known is None else Spec.from_dict(known)
            return iteration, self._read(iteration, POLICY, self._claimed(iteration, POLICY)), spec

        steps = self._written()
        if task is not None:
            of_task = {i: words["task"] == task for i, words in self._readable(steps).items()}
            steps = [i for i in steps if of_task.get(i)]
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
        except UsageError:
            raise
        except Exception as error:  # whatever a torn file makes its reader say
            raise UsageError(f"{self._damage(iteration, error)}.") from None

    def close(self) -> None:
        """Wait until everything is written."""
        self._attempt(self._manager.wait_until_finished)
        if (self.folder / str(self._wanted)).is_dir():
            self.failure = None  # what failed before has been made up for
        elif self._wanted >= 0 and self.failure is None:
            self.failure = f"'{self.folder}' has been moved or removed."
        self._attempt(self._manager.close)

    def _written(self) -> list[int]:
        """Return the iterations whose checkpoints are there, the one under way among them."""
        self._manager.wait_until_finished()
        return list(self._manager.all_steps())

    def _newest(self, read: Callable[[int], Any], steps: Sequence[int]) -> Any:
        for iteration in sorted(steps, reverse=True):
            try:
                return read(iteration)
            except UsageError:
                raise
            except Exception as error:  # whatever a torn file makes its reader say
                damage = self._damage(iteration, error)
                warn(f"{damage}; taking the one before.")
        if steps:
            raise UsageError(f"No checkpoint in '{self.folder}' can be read.")
        raise UsageError(f"'{self.folder}' holds no checkpoint.")

    def _damage(self, iteration: int, error: Exception) -> str:
        what = str(error) if isinstance(error, DamagedError) else type(error).__name__
        place = f"the checkpoint of iteration {iteration} in '{self.folder}'"
        return f"{place} cannot be read ({what})"

    def _best(self, steps: Iterable[int]) -> int | None:
        """Return the best checkpoint of the newest one's task, the newest where no return is known.

        Those whose words cannot be read are out of the question.
        """
        known = self._readable(steps)
        if not known:
            return max(steps, default=None)
        task = known[max(known)]["task"]
        return max((i for i in known if known[i]["task"] == task), key=lambda i: _rank(i, known[i]))

    def _readable(self, steps: Iterable[int]) -> dict[int, dict[str, Any]]:
        """Return the words of those checkpoints whose words can be read."""
        found = {}
        for iteration in steps:
            with contextlib.suppress(Exception):  # whatever a torn file makes its reader say
                found[iteration] = self._words(iteration)
        return found

    def _words(self, iteration: int) -> dict[str, Any]:
        words = json.loads((self.folder / str(iteration) / PROGRESS / WORDS).read_bytes())
        if words["schema"] > SCHEMA:
            raise UsageError(
                f"'{self.folder}' was written by a newer hitmdp_jax (schema {words['schema']}; "
                f"this one reads up to {SCHEMA}): upgrade to read it."
            )
        digest = words.pop("digest", None)
        older = digest is None and set(words) == BEFORE_DIGESTS
        if not older and (digest != _digest_of_words(words) or words["iteration"] != iteration):
            raise DamagedError("its words are not those that were saved")
        return words

    def _read(self, iteration: int, item: str, like: Any) -> Any:
        # Whatever devices wrote the checkpoint, it is read onto the first one of this machine.
        here = jax.sharding.SingleDeviceSharding(jax.local_devices()[0])
        target = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=here), like)
        self._check_fit(self._claimed(iteration, item), target)
        arguments = {item: ocp.args.StandardRestore(target)}  # pyright: ignore[reportCallIssue]
        found = self._manager.restore(iteration, args=ocp.args.Composite(**arguments))[item]
        saved = self._words(iteration).get("digests")  # an older package wrote none
        if saved is not None and saved.get(item) != _digest(found):
            raise DamagedError("its numbers are not those that were saved")
        return found

    def _claimed(self, iteration: int, item: str) -> Any:
        """Return the names, shapes and types that a checkpoint's item says it holds."""
        found = self._manager.item_metadata(iteration)[item]
        return getattr(found, "tree", found)

    def _check_fit(self, found: Any, wanted: Any) -> None:
        """Raise UsageError where names or shapes are not those of the run's settings."""
        there, here = _by_path(found), _by_path(wanted)
        for path in sorted({*there, *here}):
            if there.get(path) != here.get(path):
                saved, wanted = _shown(there.get(path)), _shown(here.get(path))
                raise UsageError(
                    f"The checkpoint in '{self.folder}' does not fit its config.yaml: {path} is "
                    f"{saved} in it, and {wanted} by the settings."
                )

    def _attempt(self, action: Callable[[], Any]) -> None:
        try:
            action()
        except Exception as error:  # Orbax and TensorStore raise many kinds where a disk is full
            reason = str(error).strip().splitlines() or [type(error).__name__]
            if self.failure is None:
                warn(f"a checkpoint could not be written: {reason[0]}")
            self.failure = reason[0]


class CheckpointsElsewhere(Checkpoints):
    """The checkpoints of a run that another process writes."""

    def __init__(self) -> None:
        self.failure = None

    def due(self) -> bool:
        """Return False: the process that writes has the clock."""
        return False

    def save(self, progress: Progress, recent_return: float = math.nan) -> None:
        """Save nothing."""

    def close(self) -> None:
        """Wait for nothing."""


def saved_iterations(run_dir: Path) -> list[int]:
    """Return the iterations whose checkpoints a run's folder holds, without reading them."""
    folder = run_dir / CHECKPOINTS
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    return sorted(int(name) for name in names if name.isdecimal())


def policy_of(state: TrainState) -> dict[str, Any]:
    """Return what acting needs of a state: parameters and the normaliser's mean and std."""
    normalizer = state.normalizer
    return {"params": state.learner.params, "mean": normalizer.mean, "std": normalizer.std}


def normalizer_of(policy: dict[str, Any]) -> NestedMeanStd:
    """Return the normaliser of a saved policy."""
    return NestedMeanStd(mean=policy["mean"], std=policy["std"])


def with_raw_keys(state: TrainState) -> TrainState:
    """Return a state whose key is its raw numbers, as a checkpoint holds it."""
    return state.replace(key=jax.random.key_data(state.key))


def _savable(tree: Any) -> Any:
    """Return arrays as Orbax takes them: of one of several processes in NumPy, by name.

    Of JAX's own it wants the parts that every process has; and Brax's counter is JAX's in whatever
    it is put back together from.
    """
    if not processes.several():
        return tree
    return jax.tree.map(np.asarray, ocp.tree.serialize_tree(tree, keep_empty_nodes=True))


def _size(state: TrainState) -> int:
    return sum(x.nbytes for x in jax.tree.leaves(with_raw_keys(state)))


class _BestOfEachTask(managers.PreservationPolicy):
    """Keeps the checkpoint of each task whose recent return is the highest.

    Orbax's own `BestN` forgets the returns of a run that is gone on with.

    Args:
      words: maps an iteration to the words of its checkpoint; raises where they cannot be read.
    """

    def __init__(self, words: Callable[[int], dict[str, Any]]):
        self._words = words

    def should_preserve(
        self, checkpoints: Sequence[Any], *, context: managers.PreservationContext
    ) -> Sequence[bool]:
        """Return for each checkpoint whether it is the best of its task."""
        best: dict[int, tuple[float, int]] = {}
        for checkpoint in checkpoints:
            with contextlib.suppress(Exception):  # the one that is being written, or a torn one
                words = self._words(checkpoint.step)
                if words["recent_return"] is not None:
                    rank = _rank(checkpoint.step, words)
                    best[words["task"]] = max(rank, best.get(words["task"], rank))
        kept = {iteration for _, iteration in best.values()}
        return [checkpoint.step in kept for checkpoint in checkpoints]


def _items(
    trees: dict[str, Any], spec: Spec, task: int, iteration: int, recent_return: float
) -> ocp.args.Composite:
    """Return what a checkpoint is to hold, as Orbax takes it."""
    words = {
        "schema": SCHEMA,
        "spec": spec.to_dict(),
        "task": task,
        "iteration": iteration,
        "recent_return": None if math.isnan(recent_return) else recent_return,
        "digests": {item: _digest(tree) for item, tree in trees.items()},
    }
    words["digest"] = _digest_of_words(words)
    arrays = {item: ocp.args.StandardSave(_savable(tree)) for item, tree in trees.items()}  # pyright: ignore
    return ocp.args.Composite(**arrays, **{PROGRESS: ocp.args.JsonSave(words)})  # pyright: ignore


def _rank(iteration: int, words: dict[str, Any]) -> tuple[float, int]:
    """Return what the best checkpoint has most of: its return, and of equal ones it is the newest.

    One whose return is not known is better than none.
    """
    known = words["recent_return"]
    return -math.inf if known is None else known, iteration


def _digest(tree: Any) -> str:
    """Return a digest of a tree's arrays: their names, shapes, types and every bit of them."""
    found = hashlib.sha256()
    leaves = {_name(path): x for path, x in jax.tree.leaves_with_path(tree)}
    for name in sorted(leaves):
        array = np.ascontiguousarray(jax.device_get(leaves[name]))
        found.update(f"{name} {array.dtype} {array.shape} ".encode())
        found.update(array.tobytes())
    return found.hexdigest()


def _digest_of_words(words: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()


def _by_path(tree: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree.leaves_with_path(tree, is_leaf=lambda x: hasattr(x, "shape"))
    names = (_name(path) for path, _ in leaves)
    return {
        name: tuple(np.shape(x) if not hasattr(x, "shape") else x.shape)
        for name, (_, x) in zip(names, leaves, strict=True)
    }


def _name(path: tuple[Any, ...]) -> str:
    return "/".join(map(_key, path))


def _key(entry: Any) -> str:
    for attribute in ("key", "name", "idx"):
        if hasattr(entry, attribute):
            return str(getattr(entry, attribute))
    return str(entry)


def _shown(shape: tuple[int, ...] | None) -> str:
    return "missing" if shape is None else f"an array {list(shape)}"
