"""How far a run goes, and what falls due after which iteration: counted once from its settings."""

import dataclasses
import functools

REPORT_STEPS = 2048


@dataclasses.dataclass(frozen=True)
class Schedule:
    """The iterations of a run; each collects a rollout and learns from it.

    Environment steps are those of one seed, and control steps: an action that is held for several
    counts as so many.

    Attributes:
      total_steps: environment steps asked for, on each task.
      steps_per_iteration: environment steps of an iteration.
      checkpoint_steps: environment steps after which a run saves.
      num_tasks: tasks that are trained on, one after the other; 0 where none is named.
    """

    total_steps: int
    steps_per_iteration: int
    checkpoint_steps: int
    num_tasks: int = 1

    @property
    def iterations_per_report(self) -> int:
        """Iterations between two reports: one, or as many as make up 2048 environment steps."""
        return max(1, REPORT_STEPS // self.steps_per_iteration)

    @property
    def steps_per_report(self) -> int:
        """Environment steps between two reports."""
        return self.steps_after(self.iterations_per_report)

    @functools.cached_property
    def iterations(self) -> int:
        """Iterations spent on each task, a whole number of reports."""
        return -(-self.total_steps // self.steps_per_report) * self.iterations_per_report

    @property
    def last_iteration(self) -> int:
        """Iterations of the whole run, all its tasks."""
        return self.iterations * self.num_tasks

    @property
    def env_steps(self) -> int:
        """Environment steps of the whole run."""
        return self.steps_after(self.last_iteration)

    @property
    def switch_at(self) -> int | None:
        """Environment steps after which a transfer goes on to its second task; None of one task."""
        return self.steps_after(self.iterations) if self.num_tasks > 1 else None

    def task_at(self, iteration: int) -> int:
        """Return the place, from 0, of the task of an iteration, which are counted from 1."""
        return min(max(iteration - 1, 0) // self.iterations, max(self.num_tasks - 1, 0))

    def steps_after(self, iteration: int) -> int:
        """Return the environment steps after so many iterations."""
        return iteration * self.steps_per_iteration

    def is_due(self, iteration: int, every: int) -> bool:
        """Return whether a thing done every so many environment steps is due after an iteration.

        It is done after whole reports, and at most after each.
        """
        reports = max(1, every // self.steps_per_report)
        return iteration % (reports * self.iterations_per_report) == 0

    def saves(self, iteration: int) -> bool:
        """Return whether a run saves after an iteration."""
        return self.is_due(iteration, self.checkpoint_steps)
