"""One run from settings to files: the host's side of training."""

import dataclasses
import time
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import jax
import numpy as np

from hitmdp_jax.envs.base import has_model
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.physics import NativeEngine
from hitmdp_jax.physics.speed import native_speed
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint import Checkpoints, CheckpointsElsewhere, Progress
from hitmdp_jax.runs.claim import locked
from hitmdp_jax.runs.folder import CONFIG, write
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.provenance import note_versions
from hitmdp_jax.runs.run import Run
from hitmdp_jax.runs.sinks import Sinks, Values, open_sinks
from hitmdp_jax.runs.sinks.terminal import TerminalSink
from hitmdp_jax.training.program import CAUSES, Iterate, TrainState
from hitmdp_jax.training.sweep import Training

SPEED_WINDOW = 11  # reports whose times make up the speed shown


class Hook(Protocol):
    """Something to do every so often with what was learned so far: an evaluation, a video."""

    @property
    def names(self) -> tuple[str, ...]:
        """The metrics that it adds to the report."""
        ...

    @property
    def every(self) -> int:
        """Environment steps of a seed between two calls."""
        ...

    def __call__(self, run: Run, progress: Progress) -> Values:
        """Return metrics [S] by name."""
        ...

    def close(self, stop: StopRequest) -> None:
        """End what is under way: the run has ended, early if `stop` was requested."""
        ...


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    env_steps: int  # of each seed, that are done and saved
    finished: bool
    signum: int | None  # the signal that ended it early
    diverged: dict[Training, tuple[int, str]]  # the iteration, and what was not finite
    failure: str | None  # why the last state is not saved


def run(run: Run, run_dir: Path, *, resume: bool = False, hooks: Sequence[Hook] = ()) -> Outcome:
    """Train a run and leave everything in `run_dir`, which the caller has claimed.

    The device is always one report ahead of the host: while metrics are written and shown, the next
    iterations run already. A transfer trains on its second task where the first ended. A signal
    ends the run after the iteration in progress, saved like a finished one; where several processes
    train together, after the next one of all. The first process alone writes.

    Args:
      run: what is trained.
      run_dir: its folder.
      resume: continue from the folder's newest checkpoint.
      hooks: what else to do every so often.
    """
    config = run.config
    with ExitStack() as stack:
        writes = processes.is_first()
        processes.told(lambda: stack.enter_context(locked(run_dir)))
        stop = stack.enter_context(StopRequest())
        for hook in hooks:
            stack.callback(hook.close, stop)
        checkpoints = Checkpoints(run_dir) if writes else CheckpointsElsewhere()
        stack.callback(checkpoints.close)
        agreement = processes.Agreement(stop, checkpoints.due, run.mesh)
        progress = run.restore(checkpoints) if resume else Progress(0, 0, None)
        done = config.steps_after(progress.iteration)
        terminal = TerminalSink(config.env_steps, config.trainings, done, quiet=not writes)
        sinks = Sinks(terminal)
        if writes:
            write(run_dir / CONFIG, config.to_yaml())
            note_versions(run_dir)
            sinks = Sinks(*open_sinks(config, run_dir, progress.iteration), terminal)
        stack.callback(sinks.close)
        terminal.message(title(run))
        reporter = Reporter(run, sinks, hooks)
        for task in range(progress.task, len(run.envs)):
            with terminal.compiling():
                step = stop.wait_for(lambda: prepare(run, task, progress))  # noqa: B023
            try:
                iterate(run, progress, step, agreement, reporter, checkpoints)
            except BaseException:  # an error in a report must not cost what was learned
                if not processes.several():  # of which one alone has a part
                    checkpoints.save(run.saved(progress), reporter.recent_return)
                raise
            checkpoints.save(run.saved(progress), reporter.recent_return)
            if agreement.signum:
                break
        checkpoints.close()
        return outcome(run, progress, agreement.signum, checkpoints)


def prepare(run: Run, task: int, progress: Progress) -> Iterate:
    """Move on to a task: its state into `progress`, and its iteration compiled.

    The iteration is given the replay's memory to write into; the rest of the state, which is small,
    may still be on its way into a checkpoint.
    """
    init, step = run.programs(task)
    progress.state, progress.task = run.begin(task, progress, init), task

    def donated(replay: Any, rest: TrainState) -> tuple[TrainState, Metrics]:
        return step(rest.replace(replay=replay))

    def parts(state: TrainState) -> tuple[Any, TrainState]:
        return state.replay, state.replace(replay=())

    program = jax.jit(donated, donate_argnums=0).lower(*parts(progress.state)).compile()
    return lambda state: program(*parts(state))


def iterate(
    run: Run,
    progress: Progress,
    step: Iterate,
    agreement: processes.Agreement,
    reporter: "Reporter",
    checkpoints: Checkpoints,
) -> None:
    """Train on a task to its end, or until all agree to stop."""
    config = run.config
    reporter.recent_return = float("nan")  # what the task before returned is no measure of this one
    last = (progress.task + 1) * config.iterations
    reporter.begin()
    per_checkpoint = config.iterations_in(config.checkpoint_steps)
    while progress.iteration < last and not agreement.signum:
        assert progress.state is not None
        progress.state, metrics = step(progress.state)
        progress.iteration += config.iterations_per_report
        agreement.ask()
        reporter.take(progress, metrics)
        if progress.iteration % per_checkpoint == 0 or agreement.save:
            reporter.flush()  # first the row, then the checkpoint that says it is there
            reporter.sinks.flush()
            checkpoints.save(run.saved(progress), reporter.recent_return)
    reporter.flush()


class Reporter:
    """Hands each report's metrics to the sinks, one report behind the device.

    Args:
      run: the run.
      sinks: where the metrics go.
      hooks: called when they are due; their metrics stand in the same report.
    """

    def __init__(self, run: Run, sinks: Sinks, hooks: Sequence[Hook]):
        self._run, self.sinks, self._hooks = run, sinks, hooks
        self._pending: tuple[int, dict[str, Any]] | None = None
        # When the last reports ended. Single ones come in bunches where the device runs ahead; a
        # window's speed is steady.
        self._times: deque[float] = deque(maxlen=SPEED_WINDOW)
        self.recent_return = float("nan")  # the mean over seeds, of the last report

    def begin(self) -> None:
        """Begin with a program: its speed is known from its second report on.

        In the first one's time it is compiled and warms up.
        """
        self._times.clear()

    def take(self, progress: Progress, metrics: Metrics) -> None:
        """Keep a report back until the next one is under way; report the one before."""
        self.flush()
        config = self._run.config
        extra: Values = {}
        for hook in self._hooks:
            extra |= dict.fromkeys(hook.names, np.full(len(config.trainings), np.nan))
            if progress.iteration % config.iterations_in(hook.every) == 0:
                learned = self._run.saved(progress)  # which takes all processes
                if processes.is_first():
                    extra |= hook(self._run, learned)
        self._pending = progress.iteration, metrics | extra

    def flush(self) -> None:
        """Report what was kept back."""
        if self._pending is None:
            return
        (iteration, metrics), self._pending = self._pending, None
        config = self._run.config
        size = len(config.trainings)  # without what `place` repeated
        values = {name: np.asarray(x)[:size] for name, x in metrics.items()}  # waits for the device
        self._times.append(time.perf_counter())
        steps = config.steps_per_iteration * config.iterations_per_report
        since_first = self._times[-1] - self._times[0]
        speed = steps * (len(self._times) - 1) / since_first if since_first else np.nan
        values["steps_per_second"] = np.full(size, speed)
        known = values["recent_return"][~np.isnan(values["recent_return"])]
        self.recent_return = float(known.mean()) if known.size else float("nan")
        self.sinks.write(iteration, config.steps_after(iteration), values)


def outcome(run: Run, progress: Progress, signum: int | None, checkpoints: Checkpoints) -> Outcome:
    """Return how the run ended."""
    state, config = run.saved(progress).state, run.config
    assert isinstance(state, TrainState)
    at, cause = jax.device_get((state.diverged, state.cause))
    return Outcome(
        env_steps=config.steps_after(progress.iteration),
        finished=progress.iteration >= config.last_iteration,
        signum=signum,
        diverged={
            training: (int(at[i]), CAUSES[int(cause[i])])
            for i, training in enumerate(config.trainings)
            if at[i]
        },
        failure=checkpoints.failure,
    )


def title(run: Run) -> str:
    """Return the line that says what runs, and where something would be faster."""
    config, env, devices = run.config, run.envs[0], run.mesh.devices.ravel()
    on_cpu = devices[0].platform == "cpu"
    physics = getattr(env, "backend", "of its own")  # Brax's word, which not all tasks know
    parts = [
        config.title,
        f"physics {physics} on {len(devices)} × {'CPU' if on_cpu else devices[0].device_kind}"
        + (f" in {jax.process_count()} processes" if processes.several() else ""),
        f"{config.num_envs} envs × {config.seeds} seeds"
        + (f" × {len(config.settings)} settings" if config.sweep else ""),
    ]
    if on_cpu and has_model(env) and physics != NativeEngine.name:
        speed = native_speed(env.model, env.physics.frame_skip)
        parts.append(f"physics=native would step {speed:,.0f} envs a second here")
    return ", ".join(parts)
