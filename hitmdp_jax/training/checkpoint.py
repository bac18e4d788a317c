"""Saving and restoring training states with Orbax."""

from pathlib import Path
from typing import Any

import jax
import orbax.checkpoint as ocp

from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.program import TrainState

STATE, POLICY = "state", "policy"  # the two items of a checkpoint


class Checkpoints:
    """The checkpoints of one run, numbered by iteration; the newest few are kept.

    A checkpoint holds the whole training state, for exact resuming, and beside it what acting
    needs (parameters and normaliser), which stays readable when a task's internals change. Saving
    copies first and writes in the background; training goes on meanwhile.

    Args:
      run_dir: the run's folder; checkpoints lie in its `checkpoints/`.
      keep: how many to keep.
    """

    def __init__(self, run_dir: Path, keep: int = 2):
        options = ocp.CheckpointManagerOptions(max_to_keep=keep)
        self._folder = (run_dir / "checkpoints").absolute()
        self._manager = ocp.CheckpointManager(
            self._folder, options=options, item_names=(STATE, POLICY)
        )

    def save(self, iteration: int, state: TrainState) -> None:
        """Save the state reached after `iteration` iterations, unless that is done already."""
        if self._manager.latest_step() == iteration:
            return
        items = {
            STATE: ocp.args.StandardSave(_with_raw_keys(state)),  # pyright: ignore[reportCallIssue]
            POLICY: ocp.args.StandardSave(policy_of(state)),  # pyright: ignore[reportCallIssue]
        }
        self._manager.save(iteration, args=ocp.args.Composite(**items))

    def restore(self, like: TrainState) -> tuple[int, TrainState]:
        """Return the newest checkpoint's iteration and state, on the first device.

        Args:
          like: a state of the same shapes, concrete or abstract.

        Raises:
          UsageError: there is no checkpoint.
        """
        iteration = self.latest()
        raw = self._read(iteration, STATE, jax.eval_shape(_with_raw_keys, like))
        return iteration, raw.replace(key=jax.random.wrap_key_data(raw.key))

    def restore_policy(self, like: TrainState) -> Any:
        """Return the newest checkpoint's `policy_of(state)`; Args and Raises as `restore`."""
        return self._read(self.latest(), POLICY, jax.eval_shape(policy_of, like))

    def close(self) -> None:
        """Wait until everything is written."""
        self._manager.wait_until_finished()
        self._manager.close()

    def latest(self) -> int:
        """Return the newest checkpoint's iteration; raise UsageError if there is none."""
        iteration = self._manager.latest_step()
        if iteration is None:
            raise UsageError(f"'{self._folder}' holds no checkpoint.")
        return iteration

    def _read(self, iteration: int, item: str, like: Any) -> Any:
        # Whatever devices wrote the checkpoint, it is read onto the first one of this machine.
        here = jax.sharding.SingleDeviceSharding(jax.local_devices()[0])
        target = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=here), like)
        arguments = {item: ocp.args.StandardRestore(target)}  # pyright: ignore[reportCallIssue]
        return self._manager.restore(iteration, args=ocp.args.Composite(**arguments))[item]


def policy_of(state: TrainState) -> tuple[Any, Any]:
    """Return what acting needs of a state: parameters and normaliser."""
    return state.learner.params, state.normalizer


def _with_raw_keys(state: TrainState) -> TrainState:
    return state.replace(key=jax.random.key_data(state.key))
