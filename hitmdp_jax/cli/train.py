"""Train an agent: `python train.py env=halfcheetah algo=mopg physics=native seeds=10`.

Every setting is in configs/; `python train.py --help` lists them.
"""

import os
import sys
import time
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from hitmdp_jax import plugins
from hitmdp_jax.cli.guard import check_process, guarded
from hitmdp_jax.cli.settings import (
    Settings,
    configs,
    flag_setting,
    folder_setting,
    quoted,
    run_config,
)
from hitmdp_jax.cli.tensorboard import OptionFigures
from hitmdp_jax.errors import UsageError, exit_with, nearest, unknown_name, warn
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint import saved_iterations
from hitmdp_jax.runs.claim import RUNS, already_there, claim, is_finished, newest
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import made
from hitmdp_jax.runs.host import present_cores, set_up_host
from hitmdp_jax.runs.interrupt import InterruptedRunError
from hitmdp_jax.runs.run import Run

CHANGEABLE = ("total_steps", "data_devices")  # settings that a resumed run may change
RESUMABLE = ("resume", "report", "distributed", "trust", *CHANGEABLE)  # what may be set then
MULTIRUN = ("-m", "--multirun")
FLAGS = (*MULTIRUN, "-h", "--help", "--hydra-help", "--version", "--cfg=job", "--cfg=all", "--info")
SHOWN = 10  # settings of a sweep, the best; sweep.csv has all
DIVERGED = 3  # the exit code of a run in which a seed was lost


def main() -> None:
    """Run the command line."""
    present_cores()  # the jobs of a sweep are checked before the first one is guarded
    arguments = sys.argv[1:]
    flags = [a for a in arguments if a.startswith("-")]
    multirun = bool(set(MULTIRUN) & set(flags))
    try:
        check_process()
        for flag in flags:
            if flag not in FLAGS:
                raise _unknown_flag(flag)
        settings = Settings([a for a in arguments if not a.startswith("-")], multirun)
        swept, overrides = settings.swept(), settings.overrides
        if multirun:
            overrides = [*overrides, f"hydra.sweep.dir={quoted(str(_sweep_folder(settings)))}"]
        elif not flags:
            names = [o.split("=")[0] for o in overrides]
            guarded(lambda: train(settings.values(), names), shows=False)
            return
    except UsageError as error:
        exit_with(error)

    codes = [0]

    def job(values: DictConfig) -> float | None:
        """Train one job; return its final return, which a sweeper such as Optuna's maximises."""
        plain: Any = OmegaConf.to_container(values, resolve=True)
        hydra_config = HydraConfig.get()
        names = hydra_config.overrides.task
        if swept:
            label = ",".join(_short(o) for o in names if o.split("=")[0] in swept)
            label = label.replace("/", "-")
            plain["run_dir"] = str(Path(hydra_config.sweep.dir) / label)
            print(f"job {hydra_config.job.num + 1}: {label}", flush=True)
        given = [o.split("=")[0] for o in names]
        guarded(lambda: codes.append(train(plain, given, go_on=bool(swept))), shows=False)
        if codes[-1] > 128:
            sys.exit(codes[-1])  # who stops one job means the sweep
        return final_return(Path(plain["run_dir"]), run_config(plain)) if swept else None

    sys.argv = [sys.argv[0], *flags, *overrides]
    run = hydra.main(version_base="1.3", config_path=str(configs()), config_name="config")(job)
    guarded(lambda: run() or max(codes), shows=bool(flags) and not multirun)


def _unknown_flag(flag: str) -> UsageError:
    """Return the error for a flag that there is not; it may be meant for a setting."""
    name, _, value = flag.lstrip("-").partition("=")
    settings = Settings([])
    near = nearest(name, [*settings.groups, *settings.names([])])
    if near and not nearest(flag, FLAGS):
        meant = f"{near}={value or 'VALUE'}"
        return UsageError(f"Unknown flag '{flag}': settings have no dashes, as {meant}.")
    return unknown_name("flag", flag, FLAGS)


def final_return(run_dir: Path, config: RunConfig) -> float:
    """Return a finished run's return: the interquartile mean over the seeds of its best setting."""
    from hitmdp_jax.experiments.sweeps import rank
    from hitmdp_jax.figures.curves import read_metrics

    return rank(read_metrics(run_dir, len(config.trainings)), config)[0].iqm


def _short(override: str) -> str:
    """Return a swept setting as a part of a folder's name: `env=my_task.MyTask` for a file's."""
    name, _, value = override.partition("=")
    own = plugins.is_own(value)
    return f"{name.lstrip('+').removesuffix('.name')}={plugins.label(value)}" if own else override


def _sweep_folder(settings: Settings) -> Path:
    """Return the folder of a sweep, having checked every job before the first one starts."""
    jobs = [settings.values(job) for job in settings.jobs()]
    elsewhere = any(o.startswith("hydra/launcher") for o in settings.overrides)
    for values in jobs:
        config = run_config(values)
        config.check_installed()
        if not elsewhere:
            config.check_memory()
        for flag in ("overwrite", "report", "distributed", "trust"):
            flag_setting(values, flag)
        if values["distributed"]:
            raise UsageError("distributed=true trains one run in several processes: leave -m out.")
        if values["resume"] is not None:
            raise UsageError("resume goes on with one run: leave -m out.")
    if len({str(values["run_dir"]) for values in jobs}) > 1:
        raise UsageError("run_dir names the folder of the whole sweep; it cannot be swept.")
    default = RUNS / "sweeps" / time.strftime("%Y-%m-%d_%H-%M-%S")
    return made(folder_setting(jobs[0]) or default)


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
        config.check_memory()
        if config.video_every:
            from hitmdp_jax.cli.video import check_filming

            check_filming(config)
        if go_on and run_dir is not None and already_there(run_dir, config):
            resume = run_dir
    set_up_host(config.physics, config.num_envs, len(config.trainings), config.data_devices)
    processes.check_same("settings", config.to_yaml())
    if resume is not None and processes.told(lambda: is_finished(resume, config.schedule)):
        done = f"{config.schedule.env_steps:,} env steps"
        print(f"{run_dir} is finished: {done}. A larger total_steps goes on.")
        return 0
    run = Run.create(config)  # or say why not, before a folder is made
    if resume is None:
        run_dir = Path(processes.told(lambda: str(claim(run_dir, config, overwrite))))
    assert run_dir is not None
    begun = resume is not None and processes.told(lambda: bool(saved_iterations(run_dir)))
    return _run(run, run_dir, begun, report)


def _run(run: Run, run_dir: Path, resume: bool, report: bool) -> int:
    """Train, draw what was learned, report it and say how it ended."""
    from hitmdp_jax.runs import loop
    from hitmdp_jax.runs.reporter import Hook

    config = run.config
    hooks: list[Hook] = [OptionFigures(config, run_dir)]
    if config.video_every:
        from hitmdp_jax.cli.video import Videos

        hooks.append(Videos(config, run_dir))
    if config.eval_every:
        from hitmdp_jax.cli.evaluate import Evaluation

        hooks.append(Evaluation(config, run_dir))
    try:
        outcome = loop.run(run, run_dir, resume=resume, hooks=hooks)
    except InterruptedRunError as stop:
        print(f"Stopped before the first iteration; nothing to save in {run_dir}.", flush=True)
        os._exit(128 + stop.signum)  # the compiler's thread cannot be stopped otherwise
    if not processes.is_first():
        return 128 + outcome.signum if outcome.signum else DIVERGED if outcome.diverged else 0
    if outcome.failure:
        raise UsageError(f"The last state is not saved: {outcome.failure}")
    where = f"Stopped at {outcome.env_steps:,} env steps, saved"
    print(f"{where if outcome.signum else 'Saved'} in {run_dir}.")
    # Matplotlib and SciPy take seconds to import, in which the training could run already.
    from hitmdp_jax.experiments import tables
    from hitmdp_jax.experiments.comparison import headline
    from hitmdp_jax.experiments.sweeps import draw_sweep
    from hitmdp_jax.figures.curves import draw_figures, read_metrics

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
    for training, (iteration, cause) in outcome.diverged.items():
        print(
            f"{training.name} diverged at iteration {iteration}, when its {cause} ceased to be "
            "finite; it keeps what it had learned before.",
            file=sys.stderr,
        )
    if outcome.signum:
        print(f"resume={run_dir} goes on exactly from there.")
        return 128 + outcome.signum
    if report:
        from hitmdp_jax.cli.report import write

        try:
            write(run_dir, config)
        except (UsageError, OSError) as error:
            warn(f"the report could not be written: {error}")
    return DIVERGED if outcome.diverged else 0


def _resumed(run_dir: Path, names: list[str], values: dict[str, Any]) -> RunConfig:
    """Return the settings a resumed run goes on with."""
    for name in names:
        if name not in RESUMABLE:
            raise UsageError(
                f"resume={run_dir} goes on with the run's own settings; only "
                f"{' and '.join(CHANGEABLE)} can be changed, not '{name}'."
            )
    config = RunConfig.load(run_dir, flag_setting(values, "trust"))
    if config.env is None:
        raise UsageError(f"'{run_dir}' was saved from Python and names no task to go on with.")
    changes = {name: values[name] for name in CHANGEABLE if name in names}
    changed = RunConfig.from_mapping(config.to_dict() | changes)
    if config.second_env is not None and changed.schedule.iterations != config.schedule.iterations:
        raise UsageError(
            f"'{run_dir}' is a transfer, whose total_steps = {config.total_steps:,} say when it "
            "goes over to its second task; they cannot be changed."
        )
    done = max(saved_iterations(run_dir), default=0)
    if "total_steps" in names and changed.schedule.iterations < done:
        raise UsageError(
            f"total_steps = {changed.total_steps:,} is less than the "
            f"{changed.schedule.steps_after(done):,} that '{run_dir}' has done."
        )
    return changed
