"""Draw one figure of a trained run: the targets of `reproduce` that take a RUN_DIR."""

import functools
from collections.abc import Callable
from pathlib import Path

import jax
from matplotlib.figure import Figure

from hitmdp_jax.analysis import embedding_figures, insight_figures, option_figures, tables
from hitmdp_jax.analysis.causal import WITHOUT_EACH_OPTION, table
from hitmdp_jax.analysis.directed import number_of_options
from hitmdp_jax.analysis.figures import read_metrics
from hitmdp_jax.analysis.insight import Insight
from hitmdp_jax.commands.evaluate import SEED_OFFSET
from hitmdp_jax.commands.policies import checkpoint_named
from hitmdp_jax.commands.settings import Parser
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.config import RunConfig, whole_number
from hitmdp_jax.training.folder import made
from hitmdp_jax.training.host import set_up_host
from hitmdp_jax.training.policy import load_all, places

EPISODES = 8

OF_METRICS = {"figure6": 1, "figure8": None, "figure9": None}  # -> how many runs; None: any number
OF_EPISODES: dict[str, Callable[[Insight], Figure]] = {
    "figure5": embedding_figures.figure5,
    "figure7": option_figures.figure7,
    "figure10": option_figures.figure10,
    "figure12": embedding_figures.figure12,
    "figure13": embedding_figures.figure13,
    "figure14": embedding_figures.figure14,
    "causal": insight_figures.causal_figure,
    "transitions": insight_figures.transitions_figure,
    "divergence": insight_figures.divergence_figure,
    "attention": insight_figures.attention_figure,
    "terminations": insight_figures.terminations_figure,
    "clusters": insight_figures.clusters_figure,
}


def draw(target: str, arguments: list[str]) -> int:
    """Draw a figure into the first run's `figures/`, and print where it is.

    Raises:
      UsageError: a folder holds no run, or one that the figure cannot be drawn of.
    """
    parser = Parser(prog=f"python -m hitmdp_jax.reproduce {target}", description=__doc__)
    several = target in OF_METRICS and OF_METRICS[target] is None
    parser.add_argument("run_dirs", type=Path, nargs="+" if several else 1, metavar="RUN_DIR")
    parser.add_argument("--seed", type=int, default=None, help="one of the run's; its first")
    if target in OF_EPISODES:
        parser.add_argument("--episodes", type=int, default=EPISODES, help=f"({EPISODES})")
        parser.add_argument("--checkpoint", default="newest", help="newest, best, or an iteration")
    options = parser.parse_args(arguments)
    configs = {run_dir: RunConfig.load(run_dir) for run_dir in options.run_dirs}
    if target in OF_METRICS:
        figure = _of_metrics(target, configs, options.seed)
    else:
        ((run_dir, config),) = configs.items()
        insight = insight_of(run_dir, config, options.seed, options.episodes, options.checkpoint)
        figure = OF_EPISODES[target](insight)
        if target == "causal":
            tables.show(table(insight.interventions))
    path = made(options.run_dirs[0] / "figures") / f"{target}.png"
    figure.savefig(path, dpi=150)
    print(path)
    return 0


def insight_of(
    run_dir: Path,
    config: RunConfig,
    seed: int | None = None,
    episodes: int = EPISODES,
    checkpoint: str = "newest",
) -> Insight:
    """Return what one seed's options do, on the task that it was trained on last.

    Args:
      run_dir: the run's folder.
      config: its settings.
      seed: by the number that the run gave it; None takes the first.
      episodes: how many are recorded.
      checkpoint: "newest", "best" or an iteration.

    Raises:
      UsageError: the run names no task, has no options, or no such seed or checkpoint.
    """
    number = number_of_options(config.make_agent())
    whole_number("episodes", episodes, at_least=1)
    if not config.tasks:
        raise UsageError(f"'{run_dir}' was saved from Python and names no task.")
    (place, *_) = places(config, config.seed if seed is None else seed)
    set_up_host(config.physics, episodes * (number + WITHOUT_EACH_OPTION))
    iteration, everyone = load_all(run_dir, checkpoint_named(checkpoint))
    task = config.task_at(iteration)
    key = jax.random.key(config.trainings[place].seed + SEED_OFFSET)
    env = make_env(**task, physics=config.physics)
    return Insight(everyone.of(place), env, key, episodes)


def _of_metrics(target: str, configs: dict[Path, RunConfig], seed: int | None) -> Figure:
    runs = {}
    for run_dir, config in configs.items():
        (place, *_) = places(config, config.seed if seed is None else seed)
        metrics = {name: x[place : place + 1] for name, x in read_metrics(run_dir).items()}
        name = f"{config.title}, seed {config.trainings[place].seed}"
        runs[f"{name} ({run_dir})" if name in runs else name] = metrics
    if target == "figure6":
        ((title, metrics),) = runs.items()
        return option_figures.figure6(metrics, title)
    return option_figures.figure8(runs)


TARGETS = {name: functools.partial(draw, name) for name in (*OF_METRICS, *OF_EPISODES)}
