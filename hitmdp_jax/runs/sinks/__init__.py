"""Where a run's metrics go, one file a place."""

from pathlib import Path

from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.sinks.base import Sink, Sinks, Values
from hitmdp_jax.runs.sinks.csv import CsvSink
from hitmdp_jax.runs.sinks.tensorboard import TensorboardSink
from hitmdp_jax.runs.sinks.wandb import WandbSink, require_wandb

__all__ = ["CsvSink", "Sink", "Sinks", "TensorboardSink", "Values", "WandbSink", "open_sinks"]


def open_sinks(config: RunConfig, run_dir: Path, resume_after: int) -> list[Sink]:
    """Open the files and services that a run's metrics go to.

    Args:
      config: the run's settings.
      run_dir: the run's folder.
      resume_after: the iteration that a resumed run goes on from; 0 in a new run.

    Raises:
      UsageError: a sink that was asked for is not installed.
    """
    sinks: list[Sink] = [
        CsvSink(run_dir, config.trainings, resume_after),
        TensorboardSink(run_dir, config.trainings, resume_after * config.steps_per_iteration),
    ]
    if config.wandb != "off":
        require_wandb()
        sinks.append(WandbSink(run_dir, config))
    return sinks
