"""TensorBoard events: the mean over seeds of every metric, and its deviation."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from tensorboardX import SummaryWriter

from hitmdp_jax.training.sinks.base import Values, columns


class TensorboardSink:
    """Writes events beside metrics.csv, at environment steps of one seed.

    Args:
      run_dir: the run's folder.
      resume_after: environment steps whose points stay; later ones of an earlier process do not.
    """

    name = "TensorBoard"

    def __init__(self, run_dir: Path, resume_after: int = 0):
        purge = resume_after + 1 if resume_after else None
        # The writer names files by the second: one that resumes at once must not take another's.
        suffix = f".{resume_after}"
        self._events = SummaryWriter(str(run_dir), purge_step=purge, filename_suffix=suffix)

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Add a point to each curve."""
        for name, x in columns(metrics):
            known = x[~np.isnan(x)]
            if known.size:
                self._events.add_scalar(f"{name}/mean", known.mean(), env_steps)
                if len(x) > 1:
                    self._events.add_scalar(f"{name}/std", known.std(), env_steps)
        self._events.flush()  # a killed run leaves what its checkpoint says was done

    def close(self) -> None:
        """Flush the events."""
        try:
            self._events.close()
        except OSError:
            # The writer tries once more when Python ends, and would say so at length.
            writer: Any = self._events.file_writer
            writer.event_writer = SimpleNamespace(close=lambda: None)
            raise
