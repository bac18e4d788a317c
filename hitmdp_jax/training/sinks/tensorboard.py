"""TensorBoard events: the mean over seeds of every metric, and its deviation."""

import time
from pathlib import Path

import numpy as np
from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog  # pyright: ignore
from tensorboardX.summary import scalar

from hitmdp_jax.training.sinks.base import Values, columns

FLUSH_INTERVAL = 5.0  # seconds; every flush waits for the disk


class TensorboardSink:
    """Writes events beside metrics.csv, at environment steps of one seed.

    It writes in the caller's thread: `SummaryWriter`'s own may hold points back when the process is
    killed, and a checkpoint must not be ahead of them.

    Args:
      run_dir: the run's folder.
      resume_after: environment steps whose points stay; later ones of an earlier process do not.
    """

    name = "TensorBoard"

    def __init__(self, run_dir: Path, resume_after: int = 0):
        # Files are named by the second: one that resumes at once must not take another's.
        self._events = EventsWriter(str(run_dir / "events"), f".{resume_after}")
        self._last_flush = time.monotonic()
        if resume_after:
            start = SessionLog(status=SessionLog.START)
            self._write(Event(session_log=start, step=resume_after + 1))

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Add a point to each curve."""
        for name, x in columns(metrics):
            known = x[~np.isnan(x)]
            if known.size:
                self._point(f"{name}/mean", known.mean(), env_steps)
                if len(x) > 1:
                    self._point(f"{name}/std", known.std(), env_steps)
        if time.monotonic() - self._last_flush > FLUSH_INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Put on disk what was written."""
        self._events.flush()
        self._last_flush = time.monotonic()

    def close(self) -> None:
        """Flush and close the file."""
        self._events.close()

    def _point(self, name: str, value: np.floating, env_steps: int) -> None:
        self._write(Event(summary=scalar(name, float(value)), step=env_steps))

    def _write(self, event: Event) -> None:
        event.wall_time = time.time()
        self._events.write_event(event)
