"""Draw one figure of a trained run: the targets of `reproduce` that take a RUN_DIR."""

import argparse
import functools
from collections.abc import Callable
from pathlib import Path

import jax
from matplotlib.figure import Figure

from hitmdp_jax.cli.evaluate import SEED_OFFSET
from hitmdp_jax.cli.policies import add_choice, load_chosen
from hitmdp_jax.cli.settings import Parser
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.experiments import tables
from hitmdp_jax.figures import choices, embeddings, options_in_time
from hitmdp_jax.figures.curves import read_metrics, save
from hitmdp_jax.interpret.evaluation import check_episodes
from hitmdp_jax.interpret.forced_options import number_of_options
from hitmdp_jax.interpret.interventions import WITHOUT_EACH_OPTION, table
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FIGURES, check_replaceable, refuse_link, subfolder
from hitmdp_jax.runs.host import set_up_host
from hitmdp_jax.runs.policy import places
from hitmdp_jax.video import film

EPISODES = 8


def draw_metrics(target: str, arguments: list[str]) -> int:
    """Draw a figure of runs' metrics into the first one's `figures/`, and print where it is.

    Raises:
      UsageError: a folder holds no run, or one that the figure cannot be drawn of.
    """
    parser = _parser(target)
    number = OF_METRICS[target]
    parser.add_argument("run_dirs", type=Path, nargs=number or "+", metavar="RUN_DIR")
    parser.add_argument("--seed", type=int, default=None, help="one of the run's; its first")
    options = parser.parse_args(arguments)
    configs = {run_dir: RunConfig.load(run_dir, options.trust) for run_dir in options.run_dirs}
    path = _place(options.run_dirs[0], target)
    return _save(_of_metrics(target, configs, options.seed), path)


def draw_episodes(target: str, arguments: list[str]) -> int:
    """Draw a figure of recorded episodes into the run's `figures/`; Raises as `draw_metrics`."""
    parser = _parser(target)
    add_choice(parser)
    parser.add_argument("--episodes", type=int, default=EPISODES, help=f"({EPISODES})")
    options = parser.parse_args(arguments)
    path = _place(options.run_dir, target)
    analysis = analysis_of(options)
    figure = OF_EPISODES[target](analysis)
    if target == "causal":
        tables.show(table(analysis.interventions))
    return _save(figure, path)


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


def _parser(target: str) -> Parser:
    return Parser(prog=f"python -m hitmdp_jax reproduce {target}", description=__doc__)


def _place(run_dir: Path, target: str) -> Path:
    """Return where a figure goes, having made sure before any work that it can be written."""
    refuse_link(run_dir / FIGURES)
    path = run_dir / FIGURES / f"{target}.png"
    check_replaceable(path)
    return path


def _save(figure: Figure, path: Path) -> int:
    save(figure, subfolder(path.parents[1], FIGURES) / path.name)
    print(path)
    return 0


def _filmed(analysis: OptionAnalysis) -> Figure:
    """Draw Figure 10, with pictures if there can be any here."""
    try:
        pictures = film.pictures(analysis.env, analysis.trajectories)
    except UsageError as reason:
        warn(f"figure10 shows no pictures: {reason}")
        pictures = None
    return options_in_time.figure10(analysis, pictures=pictures)


def _of_metrics(target: str, configs: dict[Path, RunConfig], seed: int | None) -> Figure:
    runs, switches = {}, {}
    for run_dir, config in configs.items():
        (place, *_) = places(config, config.seed if seed is None else seed)
        everyone = read_metrics(run_dir, len(config.trainings))
        metrics = {name: x[place : place + 1] for name, x in everyone.items()}
        name = f"{config.title}, seed {config.trainings[place].seed}"
        name = f"{name} ({run_dir})" if name in runs else name
        runs[name], switches[name] = metrics, config.switch_at
    if target == "figure6":
        ((title, metrics),) = runs.items()
        return options_in_time.figure6(metrics, title, switches[title])
    return options_in_time.figure8(runs, switches)


OF_METRICS = {"figure6": 1, "figure8": None, "figure9": None}  # -> how many runs; None: any number
OF_EPISODES: dict[str, Callable[[OptionAnalysis], Figure]] = {
    "figure5": embeddings.figure5,
    "figure7": options_in_time.figure7,
    "figure10": _filmed,
    "figure12": embeddings.figure12,
    "figure13": embeddings.figure13,
    "figure14": embeddings.figure14,
    "causal": choices.causal_figure,
    "transitions": choices.transitions_figure,
    "choices": choices.choices_figure,
    "divergence": choices.divergence_figure,
    "attention": choices.attention_figure,
    "terminations": choices.terminations_figure,
    "projection": choices.projection_figure,
}
TARGETS = {name: functools.partial(draw_metrics, name) for name in OF_METRICS} | {
    name: functools.partial(draw_episodes, name) for name in OF_EPISODES
}
