"""Where a run's metrics go, one file per place."""

from collections.abc import Callable
from pathlib import Path

from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.sinks import csv, tensorboard, wandb
from hitmdp_jax.runs.sinks.base import Sink, Sinks, Values
from hitmdp_jax.runs.sinks.csv import CsvSink
from hitmdp_jax.runs.sinks.tensorboard import TensorboardSink
from hitmdp_jax.runs.sinks.wandb import WandbSink

__all__ = [
    "SINKS",
    "CsvSink",
    "Sink",
    "Sinks",
    "TensorboardSink",
    "Values",
    "WandbSink",
    "open_sinks",
]

Opener = Callable[[RunConfig, Path, int], Sink | None]  # None: the settings do not ask for it
SINKS: tuple[Opener, ...] = (csv.open_sink, tensorboard.open_sink, wandb.open_sink)


def open_sinks(config: RunConfig, run_dir: Path, resume_after: int) -> list[Sink]:
    """Open the files and services that a run's metrics go to.

    Args:
      config: the run's settings.
      run_dir: the run's folder.
      resume_after: the iteration that a resumed run goes on from; 0 in a new run.

    Raises:
      UsageError: a sink that was asked for is not installed.
    """
    opened = (open_sink(config, run_dir, resume_after) for open_sink in SINKS)
    return [sink for sink in opened if sink is not None]
