"""Draw one figure, of trained runs or of random option frameworks."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import fill

import jax
import numpy as np
from matplotlib.figure import Figure

from hitmdp_jax.cli.policies import (
    check_output,
    evaluation_key,
    file_name,
    load_chosen,
    load_config,
    on_task,
    output,
)
from hitmdp_jax.cli.run_settings import writable
from hitmdp_jax.cli.waiting import working
from hitmdp_jax.errors import UsageError, out_of_domain, warn
from hitmdp_jax.experiments import tables
from hitmdp_jax.figures import registry, theorems
from hitmdp_jax.figures.curves import save
from hitmdp_jax.figures.registry import Entry, Needs, RunMetrics
from hitmdp_jax.figures.style import plain
from hitmdp_jax.interpret.evaluation import check_episodes, task_env
from hitmdp_jax.interpret.interventions import WITHOUT_EACH_OPTION, table
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.option_use import number_of_options
from hitmdp_jax.interpret.summary import Summary, rank
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FIGURES
from hitmdp_jax.runs.host import set_up_host, solver_of
from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.runs.policy import places
from hitmdp_jax.video import filmstrip

LETTERS, INCHES = 13, 0.2  # of a title: how many fit into an inch, and how high a line is
EPISODES = 8  # to record, where a figure shows episodes
PICTURES: dict[Needs, Callable[[OptionAnalysis], Mapping[int, np.ndarray]]] = {
    Needs.PICTURES: lambda analysis: filmstrip.pictures(analysis.env, analysis.trajectories),
    Needs.POSES: filmstrip.poses,
}


def run(arguments: argparse.Namespace) -> None:
    """Do what `hitmdp figure` says.

    Raises:
      UsageError: the figure cannot be drawn of what the folders hold, or of so many folders.
    """
    name = arguments.name
    entry = registry.find(name)
    _check(entry, arguments)
    path = Path(f"{file_name(name, arguments.env)}.png")
    if arguments.out or arguments.run_dirs:
        path = output(arguments, FIGURES, path.name)
    writable("--out", path)  # before any work; the folder is made once there is a figure
    with working(f"drawing {name}"):
        figure = _drawn(entry, arguments)
    check_output(path)
    save(figure, path)
    print(path)


def _check(entry: Entry, arguments: argparse.Namespace) -> None:
    """Raise UsageError where a figure is drawn of fewer runs, or of more, or shows no episodes."""
    number, name = len(arguments.run_dirs), arguments.name
    if entry.needs == Needs.MODELS and number:
        raise UsageError(f"{name} is a figure of random option frameworks: leave RUN_DIR out.")
    if entry.needs != Needs.MODELS and not number:
        raise UsageError(f"{name} is a figure of {entry.needs.value}: name a RUN_DIR.")
    if entry.needs != Needs.RUNS and number > 1:
        raise UsageError(f"{name} is a figure of {entry.needs.value}: name one RUN_DIR.")
    everyone = entry.needs in (Needs.TRAININGS, Needs.SETTINGS)
    if everyone and arguments.seed is not None:
        raise UsageError(f"--seed has no effect: {name} shows all seeds.")
    if entry.needs not in (Needs.EPISODES, *PICTURES):
        for flag in ("setting", "checkpoint", "task", "episodes", "env"):
            if getattr(arguments, flag) is not None:
                raise UsageError(f"--{flag} has no effect: {name} shows no episodes.")


def _drawn(entry: Entry, arguments: argparse.Namespace) -> Figure:
    """Draw a figure of what it needs."""
    if entry.needs == Needs.MODELS:
        seed = arguments.seed or 0
        if not 0 <= seed < 2**32:
            raise out_of_domain("seed", seed, "a whole number from 0 to 4294967295")
        with jax.enable_x64(True):
            return entry.draw(theorems.sample_models(jax.random.key(seed)))
    if entry.needs in (Needs.TRAININGS, Needs.SETTINGS):
        return entry.draw(_of_all_trainings(entry.needs, arguments))
    if entry.needs in (Needs.METRICS, Needs.RUNS):
        runs = metrics_of(arguments)
        return entry.draw(runs if entry.needs == Needs.RUNS else runs[0])
    title, analysis = analysis_of(arguments)
    more = [_pictures(entry.needs, arguments.name, analysis)] if entry.needs in PICTURES else []
    figure = entry.draw(analysis, *more)
    if arguments.name == "causal":
        tables.show(table(analysis.interventions))
    return titled(figure, title)


def titled(figure: Figure, title: str) -> Figure:
    """Return a figure that says above all else, on lines of its own, what it is of."""
    width, height = figure.get_size_inches()
    lines = fill(plain(title), int(LETTERS * width))
    figure.suptitle("\n".join(filter(None, (lines, figure.get_suptitle()))), fontsize="small")
    figure.set_size_inches(width, height + INCHES * (1 + lines.count("\n")))
    return figure


def analysis_of(arguments: argparse.Namespace) -> tuple[str, OptionAnalysis]:
    """Return a policy's name, and the analysis of its options on the task trained on last.

    It is made on another task where the command line names one.

    Raises:
      UsageError: there is no task, the run has no options, or no such seed or checkpoint.
    """
    config = load_config(arguments)
    number = number_of_options(config.make_agent())
    episodes = EPISODES if arguments.episodes is None else arguments.episodes
    check_episodes(episodes)
    shown = on_task(config, arguments.env)
    solver = solver_of(shown, shown.physics)
    set_up_host(solver, episodes * (number + WITHOUT_EACH_OPTION))
    choice = load_chosen(arguments, config, shown)
    env = task_env(choice.task, shown.physics)
    title = f"{choice.title}, {episodes} episode{'s' * (episodes > 1)}"
    return title, OptionAnalysis(choice.policy, env, evaluation_key(choice.training), episodes)


def _of_all_trainings(
    needs: Needs, arguments: argparse.Namespace
) -> RunMetrics | Mapping[str, Summary]:
    """Return a run's metrics, or the settings of a sweep, the best first.

    Raises:
      UsageError: the run sweeps nothing, or has no iteration yet.
    """
    (run_dir,) = arguments.run_dirs
    config = RunConfig.load(run_dir, arguments.trust)
    metrics = read_metrics(run_dir, len(config.trainings))
    if not metrics:
        raise UsageError(f"The run {config.title} has no iteration yet.")
    if needs == Needs.TRAININGS:
        return RunMetrics(config.title, metrics, config.algo["name"], config.switch_at)
    if not config.sweep:
        raise UsageError(f"The run {config.title} sweeps nothing.")
    return rank(config, metrics)


def metrics_of(arguments: argparse.Namespace) -> list[RunMetrics]:
    """Return the metrics of one training of each run."""
    configs = {path: RunConfig.load(path, arguments.trust) for path in arguments.run_dirs}
    runs: list[RunMetrics] = []
    for run_dir, config in configs.items():
        (number, *_) = places(
            config.trainings, config.seed if arguments.seed is None else arguments.seed
        )
        everyone = read_metrics(run_dir, len(config.trainings))
        metrics = {column: x[number : number + 1] for column, x in everyone.items()}
        title = f"{config.title}, seed {config.trainings[number].seed}"
        if any(title == other.title for other in runs):
            title = f"{title} ({run_dir})"
        runs.append(RunMetrics(title, metrics, config.algo["name"], config.switch_at))
    return runs


def _pictures(needs: Needs, name: str, analysis: OptionAnalysis) -> Mapping[int, np.ndarray]:
    """Return the pictures that a figure needs; none, with a warning, where nothing can be drawn."""
    try:
        return PICTURES[needs](analysis)
    except UsageError as reason:
        warn(f"{name} shows no pictures: {reason}")
        return {}
