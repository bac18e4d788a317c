"""What a run tells of each report, and what else it does every so often."""

import dataclasses
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from hitmdp_jax.metrics import Metrics
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.schedule import Schedule
from hitmdp_jax.runs.sinks import Sinks, Values

SPEED_WINDOW = 11  # reports whose times make up the speed shown


class Hook(Protocol):
    """Something to do every so often with what was learned so far: an evaluation, a video.

    A hook whose `stopped` says why ends the run.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """The metrics that it adds to the report."""
        ...

    @property
    def every(self) -> int:
        """Environment steps of a seed between two calls."""
        ...

    def __call__(self, progress: Progress, env_steps: int) -> Values:
        """Return metrics [R] by name.

        Args:
          progress: where the run stands, as a checkpoint keeps it, and its metrics in `report`.
          env_steps: environment steps of a seed until then.
        """
        ...

    def close(self, stop: StopRequest) -> None:
        """End what is under way: the run has ended, early if `stop` was requested."""
        ...


class Reporter:
    """Hands each report's metrics to the sinks, one report behind the device.

    Args:
      schedule: of the run.
      size: its trainings, R.
      sinks: where the metrics go.
      hooks: called when they are due; their metrics stand in the same report.
      saved: maps where the run stands to what is kept of it; all processes are needed.
    """

    def __init__(
        self,
        schedule: Schedule,
        size: int,
        sinks: Sinks,
        hooks: Sequence[Hook],
        saved: Callable[[Progress], Progress],
    ):
        self._schedule, self._size = schedule, size
        self.sinks, self._hooks, self._saved = sinks, hooks, saved
        self._pending: tuple[int, dict[str, Any]] | None = None
        # When the last reports ended. Single ones come in bunches where the device runs ahead; a
        # window's speed is steady.
        self._times: deque[float] = deque(maxlen=SPEED_WINDOW)
        self.recent_return = float("nan")  # the mean over seeds, of the last report
        self.stopped: str | None = None  # why a hook stops the run

    def begin(self) -> None:
        """Begin with a task: what the one before returned is no measure of it.

        The speed of its program, which is compiled and warms up in its first report, is known from
        the second on.
        """
        self._times.clear()
        self.recent_return = float("nan")

    def take(self, progress: Progress, metrics: Metrics) -> None:
        """Keep a report back until the next one is under way; report the one before."""
        self.flush()
        extra: Values = {}
        for hook in self._hooks:
            extra |= dict.fromkeys(hook.names, np.full(self._size, np.nan))
            if self._schedule.is_due(progress.iteration, hook.every):
                learned = dataclasses.replace(self._saved(progress), report=metrics)
                if processes.is_first():
                    extra |= hook(learned, self._schedule.steps_after(progress.iteration))
                stopped = processes.told(lambda: getattr(hook, "stopped", None))  # noqa: B023
                self.stopped = self.stopped or stopped
        self._pending = progress.iteration, metrics | extra

    def flush(self) -> None:
        """Report what was kept back."""
        if self._pending is None:
            return
        (iteration, metrics), self._pending = self._pending, None
        # Without what `place` repeated. It waits for the device.
        values = {name: np.asarray(x)[: self._size] for name, x in metrics.items()}
        self._times.append(time.perf_counter())
        since_first = self._times[-1] - self._times[0]
        steps = self._schedule.steps_per_report * (len(self._times) - 1)
        speed = steps / since_first if since_first else np.nan
        values["steps_per_second"] = np.full(self._size, speed)
        known = values["recent_return"][~np.isnan(values["recent_return"])]
        self.recent_return = float(known.mean()) if known.size else float("nan")
        self.sinks.write(iteration, self._schedule.steps_after(iteration), values)
