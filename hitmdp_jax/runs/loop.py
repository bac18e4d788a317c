"""One run from settings to files: the host's side of training."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import jax

from hitmdp_jax.envs.base import has_model
from hitmdp_jax.physics import NativeEngine
from hitmdp_jax.physics.speed import native_speed
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress
from hitmdp_jax.runs.claim import locked
from hitmdp_jax.runs.folder import CONFIG, write
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.provenance import note_versions
from hitmdp_jax.runs.reporter import Hook, Reporter
from hitmdp_jax.runs.run import Run
from hitmdp_jax.runs.schedule import Schedule
from hitmdp_jax.runs.sinks import Sinks, open_sinks
from hitmdp_jax.runs.sinks.terminal import TerminalSink
from hitmdp_jax.training.divergence import CAUSES
from hitmdp_jax.training.host_loop import compiled
from hitmdp_jax.training.program import Iterate
from hitmdp_jax.training.sweep import Training


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    env_steps: int  # of each seed, that are done and saved
    finished: bool
    signum: int | None  # the signal that ended it early
    diverged: dict[Training, tuple[int, str]]  # the iteration, and what was not finite
    failure: str | None  # why the last state is not saved
    stopped: str | None = None  # why a hook ended it early


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
    with ExitStack() as stack:
        processes.told(lambda: stack.enter_context(locked(run_dir)))
        stop = stack.enter_context(StopRequest())
        for hook in hooks:
            stack.callback(hook.close, stop)
        checkpoints = Checkpoints(run_dir) if processes.is_first() else None
        if checkpoints:
            stack.callback(checkpoints.close)
        due = checkpoints.due if checkpoints else lambda: False  # who writes has the clock
        agreement = processes.Agreement(stop, due, run.mesh)
        progress = run.restore(checkpoints) if resume else Progress(0, 0, None)
        terminal, sinks = begin(run, run_dir, progress.iteration)
        stack.callback(sinks.close)
        reporter = Reporter(run.schedule, len(run.trainings), sinks, hooks, run.saved)

        def save() -> None:
            learned = run.saved(progress)  # which takes all processes
            if checkpoints:
                checkpoints.save(learned, reporter.recent_return)

        for task in range(progress.task, len(run.envs)):
            with terminal.compiling():
                step = stop.wait_for(lambda: prepare(run, task, progress))  # noqa: B023
            with _saved_whatever_happens(save):
                iterate(run.schedule, progress, step, agreement, reporter, save)
            if agreement.signum or reporter.stopped:
                break
        if checkpoints:
            checkpoints.close()
        failure = checkpoints.failure if checkpoints else None
        ended = outcome(run, progress, agreement.signum, failure)
        return dataclasses.replace(ended, stopped=None if ended.finished else reporter.stopped)


@contextmanager
def _saved_whatever_happens(save: Callable[[], None]) -> Iterator[None]:
    """Save at the end; an error in a report must not cost what was learned."""
    try:
        yield
    except BaseException:
        if not processes.several():  # of which one alone has a part
            save()
        raise
    save()


def begin(run: Run, run_dir: Path, iteration: int) -> tuple[TerminalSink, Sinks]:
    """Note in a run's folder what trains it from an iteration on; open what it tells.

    Returns:
      The terminal, which says what runs, and all sinks, the terminal among them.
    """
    schedule, writes = run.schedule, processes.is_first()
    done = schedule.steps_after(iteration)
    terminal = TerminalSink(schedule.env_steps, run.trainings, done, quiet=not writes)
    terminal.message(title(run))
    if not writes:
        return terminal, Sinks(terminal)
    write(run_dir / CONFIG, run.config.to_yaml())
    note_versions(run_dir)
    return terminal, Sinks(*open_sinks(run.config, run_dir, iteration), terminal)


def prepare(run: Run, task: int, progress: Progress) -> Iterate:
    """Move on to a task: its state into `progress`, and its iteration compiled."""
    init, step = run.programs(task)
    progress.state, progress.task = run.begin(task, progress, init), task
    return compiled(step, progress.state)


def iterate(
    schedule: Schedule,
    progress: Progress,
    step: Iterate,
    agreement: processes.Agreement,
    reporter: Reporter,
    save: Callable[[], None],
) -> None:
    """Train on a task to its end, or until all agree to stop.

    Args:
      schedule: of the run.
      progress: where the run stands, which moves on.
      step: iterations of one report.
      agreement: of all processes, to stop or to save.
      reporter: takes each report.
      save: writes a checkpoint.
    """
    last = (progress.task + 1) * schedule.iterations
    reporter.begin()
    while progress.iteration < last and not (agreement.signum or reporter.stopped):
        assert progress.state is not None
        progress.state, metrics = step(progress.state)
        progress.iteration += schedule.iterations_per_report
        agreement.ask()
        reporter.take(progress, metrics)
        if schedule.saves(progress.iteration) or agreement.save:
            reporter.flush()  # first the row, then the checkpoint that says it is there
            reporter.sinks.flush()
            save()
    reporter.flush()


def outcome(run: Run, progress: Progress, signum: int | None, failure: str | None) -> Outcome:
    """Return how the run ended; `failure` is why its last state is not saved."""
    state = run.saved(progress).state
    assert state is not None
    at, cause = jax.device_get((state.diverged, state.cause))
    return Outcome(
        env_steps=run.schedule.steps_after(progress.iteration),
        finished=progress.iteration >= run.schedule.last_iteration,
        signum=signum,
        diverged={
            training: (int(at[i]), CAUSES[int(cause[i])])
            for i, training in enumerate(run.trainings)
            if at[i]
        },
        failure=failure,
    )


def title(run: Run) -> str:
    """Return the line that says what runs, and where something would be faster."""
    config, env, devices = run.config, run.envs[0], run.mesh.devices.ravel()
    on_cpu = devices[0].platform == "cpu"
    physics = getattr(env, "backend", "none")  # Brax's word, which not all tasks know
    simulated = "" if physics == "none" else f"physics {physics} "
    parts = [
        config.title,
        f"{simulated}on {len(devices)} × {'CPU' if on_cpu else devices[0].device_kind}"
        + (f" in {jax.process_count()} processes" if processes.several() else ""),
        f"{config.num_envs} envs × {config.seeds} seeds"
        + (f" × {len(config.settings)} settings" if config.sweep else ""),
    ]
    if on_cpu and has_model(env) and physics != NativeEngine.name:
        speed = native_speed(env.model, env.physics.frame_skip)
        parts.append(f"physics=native would make {speed:,.0f} steps per second here")
    return ", ".join(parts)
