"""Saving and restoring training states with Orbax."""

from pathlib import Path
from typing import Any

import jax
import orbax.checkpoint as ocp

from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.program import TrainState


class Checkpoints:
    """The checkpoints of one run, numbered by iteration; the newest few are kept.

    Saving copies the state first and writes in the background; training goes on meanwhile.

    Args:
      run_dir: the run's folder; checkpoints lie in its `checkpoints/`.
      keep: how many to keep.
    """

    def __init__(self, run_dir: Path, keep: int = 2):
        options = ocp.CheckpointManagerOptions(max_to_keep=keep)
        self._folder = (run_dir / "checkpoints").absolute()
        self._manager = ocp.CheckpointManager(self._folder, options=options)

    def save(self, iteration: int, state: TrainState) -> None:
        """Save the state reached after `iteration` iterations, unless that is done already."""
        if self._manager.latest_step() != iteration:
            self._manager.save(iteration, args=ocp.args.StandardSave(_with_raw_keys(state)))

    def restore(self, like: TrainState) -> tuple[int, TrainState]:
        """Return the newest checkpoint's iteration and state.

        Args:
          like: a state of the same shapes, concrete or abstract.

        Raises:
          UsageError: there is no checkpoint.
        """
        iteration = self._manager.latest_step()
        if iteration is None:
            raise UsageError(f"'{self._folder}' holds no checkpoint.")
        raw = jax.eval_shape(_with_raw_keys, like)
        restored = self._manager.restore(iteration, args=ocp.args.StandardRestore(raw))
        return iteration, _with_typed_keys(restored)

    def close(self) -> None:
        """Wait until everything is written."""
        self._manager.wait_until_finished()
        self._manager.close()


def _with_raw_keys(state: TrainState) -> Any:
    return state.replace(key=jax.random.key_data(state.key))


def _with_typed_keys(state: Any) -> TrainState:
    return state.replace(key=jax.random.wrap_key_data(state.key))
