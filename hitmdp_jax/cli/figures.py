"""Draw one figure of a trained run: the targets of `reproduce` that take a RUN_DIR."""

import argparse
import functools
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from hitmdp_jax.cli.evaluate import SEED_OFFSET
from hitmdp_jax.cli.policies import add_choice, load_chosen
from hitmdp_jax.cli.settings import Parser
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.experiments import tables
from hitmdp_jax.figures.curves import read_metrics, save
from hitmdp_jax.figures.registry import Needs, RunMetrics, find, summaries
from hitmdp_jax.interpret.evaluation import check_episodes
from hitmdp_jax.interpret.interventions import WITHOUT_EACH_OPTION, table
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.option_use import number_of_options
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FIGURES, check_replaceable, refuse_link, subfolder
from hitmdp_jax.runs.host import set_up_host
from hitmdp_jax.runs.policy import places
from hitmdp_jax.video import filmstrip

EPISODES = 8


def draw(name: str, arguments: list[str]) -> int:
    """Draw a figure of a run, or of several, into its `figures/`, and print where it is.

    Raises:
      UsageError: a folder holds no run, or one that the figure cannot be drawn of.
    """
    entry = find(name)
    if entry.needs == Needs.MODELS:
        raise UsageError(f"{name} is a figure of no run: `reproduce theory` draws it.")
    parser = Parser(prog=f"python -m hitmdp_jax reproduce {name}", description=__doc__)
    if entry.needs in (Needs.METRICS, Needs.RUNS):
        number = "+" if entry.needs == Needs.RUNS else 1
        parser.add_argument("run_dirs", type=Path, metavar="RUN_DIR", nargs=number)
        parser.add_argument("--seed", type=int, default=None, help="one of the run's; its first")
        options = parser.parse_args(arguments)
        configs = {folder: RunConfig.load(folder, options.trust) for folder in options.run_dirs}
        path = _file(options.run_dirs[0], name)
        runs = _metrics_of(configs, options.seed)
        figure = entry.draw(runs if entry.needs == Needs.RUNS else runs[0])
    else:
        add_choice(parser)
        parser.add_argument("--episodes", type=int, default=EPISODES, help=f"({EPISODES})")
        options = parser.parse_args(arguments)
        path = _file(options.run_dir, name)
        analysis = analysis_of(options)
        more = [_pictures(name, analysis)] if entry.needs == Needs.PICTURES else []
        figure = entry.draw(analysis, *more)
        if name == "causal":
            tables.show(table(analysis.interventions))
    save(figure, subfolder(path.parents[1], FIGURES) / path.name)
    print(path)
    return 0


def analysis_of(options: argparse.Namespace) -> OptionAnalysis:
    """Return what the options of a policy do, on the task that it was trained on last.

    Args:
      options: what `add_choice` made of a command line, and the number of `episodes`.

    Raises:
      UsageError: the run names no task, has no options, or no such seed or checkpoint.
    """
    config = RunConfig.load(options.run_dir, options.trust)
    number = number_of_options(config.make_agent())
    check_episodes(options.episodes)
    if not config.tasks:
        raise UsageError(f"'{options.run_dir}' was saved from Python and names no task.")
    set_up_host(config.physics, options.episodes * (number + WITHOUT_EACH_OPTION))
    choice = load_chosen(options)
    key = jax.random.key(choice.training.seed + SEED_OFFSET)
    env = make_env(**choice.task, physics=config.physics)
    return OptionAnalysis(choice.policy, env, key, options.episodes)


def listing() -> str:
    """Return the figures of runs by name, a line each."""
    return "".join(f"  {name:<13} {line}\n" for name, line in summaries().items())


def _file(run_dir: Path, name: str) -> Path:
    """Return where a figure goes, having made sure before any work that it can be written."""
    refuse_link(run_dir / FIGURES)
    path = run_dir / FIGURES / f"{name}.png"
    check_replaceable(path)
    return path


def _pictures(name: str, analysis: OptionAnalysis) -> Mapping[int, np.ndarray]:
    """Return pictures of the first episode; none, with a warning, where nothing can be drawn."""
    try:
        return filmstrip.pictures(analysis.env, analysis.trajectories)
    except UsageError as reason:
        warn(f"{name} shows no pictures: {reason}")
        return {}


def _metrics_of(configs: dict[Path, RunConfig], seed: int | None) -> list[RunMetrics]:
    """Return the metrics of one training of each run."""
    runs: list[RunMetrics] = []
    for run_dir, config in configs.items():
        (number, *_) = places(config.trainings, config.seed if seed is None else seed)
        everyone = read_metrics(run_dir, len(config.trainings))
        metrics = {column: x[number : number + 1] for column, x in everyone.items()}
        title = f"{config.title}, seed {config.trainings[number].seed}"
        if any(title == other.title for other in runs):
            title = f"{title} ({run_dir})"
        runs.append(RunMetrics(title, metrics, config.algo["name"], config.switch_at))
    return runs


TARGETS = {name: functools.partial(draw, name) for name in summaries()}
