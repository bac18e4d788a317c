"""One training of the command line: from checked settings to its page, and the exit code."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hitmdp_jax.cli.run_settings import flag_setting, folder_setting, run_config
from hitmdp_jax.cli.tensorboard import OptionFigures
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.callbacks import has_reached, own_code
from hitmdp_jax.runs.checkpoint import saved_iterations
from hitmdp_jax.runs.claim import already_there, claim, is_finished, newest
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.host import set_up_host, solver_of
from hitmdp_jax.runs.interrupt import InterruptedRunError
from hitmdp_jax.runs.memory import check_run_memory
from hitmdp_jax.runs.run import Run

if TYPE_CHECKING:
    from hitmdp_jax.runs.reporter import Hook

CHANGEABLE = ("total_steps", "data_devices", "stop_at_return")  # by a resumed run
RESUMABLE = ("resume", "report", "distributed", "trust", *CHANGEABLE)  # what may be set then
SHOWN = 10  # settings of a sweep, the best; sweep.csv has all
DIVERGED = 3  # the exit code of a run in which a seed was lost


@processes.ending_together()
def train(values: dict[str, Any], names: list[str], go_on: bool = False) -> int:
    """Train as the settings say; return the exit code.

    Args:
      values: every setting by name.
      names: the settings that the command line names.
      go_on: continue a run of the same settings where the folder holds one.

    Raises:
      UsageError: a setting or a folder is unusable.
    """
    run_dir, resume = folder_setting(values), folder_setting(values, "resume")
    overwrite, report = (flag_setting(values, name) for name in ("overwrite", "report"))
    if flag_setting(values, "distributed"):
        processes.join()
    if resume is not None:
        resume = run_dir = newest() if str(resume) == "latest" else resume
        config = _resumed(resume, names, values)
    else:
        config = run_config(values)
        config.check_installed()
        check_run_memory(config)
        if go_on and run_dir is not None and already_there(run_dir, config):
            resume = run_dir
    solver = solver_of(config, config.physics)
    set_up_host(solver, config.num_envs, len(config.trainings), config.data_devices)
    processes.check_same("settings", config.to_yaml())
    if resume is not None and processes.told(lambda: is_finished(resume, config.schedule)):
        done = f"{config.schedule.env_steps:,} env steps"
        print(f"{run_dir} is finished: {done}. A larger total_steps continues it.")
        return 0
    if resume is not None and processes.told(lambda: has_reached(resume, config)):
        reached = f"has reached stop_at_return = {config.stop_at_return:g}"
        print(f"{run_dir} {reached}. A higher one goes on, and so does stop_at_return=null.")
        return 0
    begun = resume is not None and processes.told(lambda: bool(saved_iterations(resume)))
    hooks = own_code(config)
    run = Run.create(config)  # or say why not, before a folder is made
    if config.video_every and resume is None:
        from hitmdp_jax.cli.video import check_filming

        for env, task in zip(run.envs, config.tasks, strict=True):
            check_filming(env, task["name"])
    begins_with = run.refills() if begun else run.begins_with()
    if resume is None:
        run_dir = Path(processes.told(lambda: str(claim(run_dir, config, overwrite))))
    assert run_dir is not None
    if begins_with and processes.is_first():
        print(begins_with)
    return _run(run, run_dir, begun, report, hooks)


def _run(run: Run, run_dir: Path, resume: bool, report: bool, own: Sequence["Hook"]) -> int:
    """Train, draw what was learned, report it and say how it ended."""
    from hitmdp_jax.runs import loop

    try:
        outcome = loop.run(run, run_dir, resume=resume, hooks=_hooks(run.config, run_dir, own))
    except InterruptedRunError as stop:
        print(f"Stopped before the first iteration; nothing to save in {run_dir}.", flush=True)
        os._exit(128 + stop.signum)  # the compiler's thread cannot be stopped otherwise
    code = 128 + outcome.signum if outcome.signum else DIVERGED if outcome.diverged else 0
    if not processes.is_first():
        return code
    if outcome.failure:
        raise UsageError(f"The last state is not saved: {outcome.failure}")
    where = f"Stopped at {outcome.env_steps:,} env steps, "
    where += f"as {outcome.stopped}, saved" if outcome.stopped else "saved"
    print(f"{where if outcome.signum or outcome.stopped else 'Saved'} in {run_dir}.")
    _draw(run.config, run_dir)
    for training, (iteration, cause) in outcome.diverged.items():
        print(
            f"{training.name} diverged at iteration {iteration}, when its {cause} was no longer "
            "finite; it keeps what it had learned before.",
            file=sys.stderr,
        )
    if outcome.signum:
        how = "with an empty replay" if run.refills() else "exactly"
        print(f"resume={run_dir} continues {how} from there.")
    elif report:
        _report(run.config, run_dir)
    return code


def _hooks(config: RunConfig, run_dir: Path, own: Sequence["Hook"]) -> list["Hook"]:
    """Return what a run does every so often: what its settings say, and what is one's own."""
    hooks: list[Hook] = [OptionFigures(config, run_dir), *own]
    if config.video_every:
        from hitmdp_jax.cli.video import Videos

        hooks.append(Videos(config, run_dir))
    if config.eval_every:
        from hitmdp_jax.cli.evaluate import Evaluation

        hooks.append(Evaluation(config, run_dir))
    return hooks


def _draw(config: RunConfig, run_dir: Path) -> None:
    """Say how much reward a run came to, and draw its figures; of a sweep, its table."""
    # Matplotlib and SciPy take seconds to import, in which the training could run already.
    from hitmdp_jax.experiments import tables
    from hitmdp_jax.experiments.sweeps import draw_sweep
    from hitmdp_jax.figures.curves import draw_figures
    from hitmdp_jax.interpret.returns import headline
    from hitmdp_jax.runs.metrics import read_metrics

    try:
        if config.sweep:
            tables.show(draw_sweep(run_dir, config)[: 1 + SHOWN])
        elif metrics := read_metrics(run_dir, len(config.trainings)):
            name, score = headline(metrics, config.switch_at)
            print(f"{name.capitalize()}: {score}.")
            draw_figures(run_dir, config.title, config.algo["name"], config.switch_at)
    except (OSError, UsageError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        warn(f"the figures could not be drawn: {reason}")


def _report(config: RunConfig, run_dir: Path) -> None:
    """Write the page about a run, or warn why there is none."""
    from hitmdp_jax.cli.report import write

    try:
        write(run_dir, config)
    except (UsageError, OSError) as error:
        warn(f"the report could not be written: {error}")


def _resumed(run_dir: Path, names: list[str], values: dict[str, Any]) -> RunConfig:
    """Return the settings a resumed run goes on with."""
    for name in names:
        if name not in RESUMABLE:
            raise UsageError(
                f"resume={run_dir} continues the run with its own settings; only "
                f"{', '.join(CHANGEABLE[:-1])} and {CHANGEABLE[-1]} can be changed, not '{name}'."
            )
    config = RunConfig.load(run_dir, flag_setting(values, "trust"))
    if config.env is None:
        raise UsageError(f"'{run_dir}' was saved from Python and names no task to continue.")
    changes = {name: values[name] for name in CHANGEABLE if name in names}
    changed = RunConfig.from_mapping(config.to_dict() | changes)
    if config.second_env is not None and changed.schedule.iterations != config.schedule.iterations:
        raise UsageError(
            f"'{run_dir}' is a transfer: total_steps = {config.total_steps:,} decide when it "
            "changes to its second task, so they cannot be changed."
        )
    done = max(saved_iterations(run_dir), default=0)
    if "total_steps" in names and changed.schedule.iterations < done:
        raise UsageError(
            f"total_steps = {changed.total_steps:,} is less than the "
            f"{changed.schedule.steps_after(done):,} that '{run_dir}' has done."
        )
    return changed
