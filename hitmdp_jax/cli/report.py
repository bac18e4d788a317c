"""Write one page about a run, or one that compares several."""

import argparse
import functools
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from hitmdp_jax.cli.command_line import command_line
from hitmdp_jax.cli.policies import evaluation_key, file_name, on_task
from hitmdp_jax.cli.run_settings import writable
from hitmdp_jax.cli.waiting import working
from hitmdp_jax.envs import engine_for
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import Trajectories, run_episodes
from hitmdp_jax.interpret.evaluation import check_episodes, check_fit, task_env
from hitmdp_jax.runs import folder
from hitmdp_jax.runs.config import RunConfig, Task
from hitmdp_jax.runs.host import set_up_host
from hitmdp_jax.runs.policy import Policy, load_all, places

if TYPE_CHECKING:
    from hitmdp_jax.interpret.option_analysis import OptionAnalysis

EPISODES = 8
FILMED, CLIPPED = 12.0, 2.5  # seconds of the page's video, and of the clip of an option
PIXELS = (480, 360)  # its size, which is that of a page and not of a film
ENGINE = "native"  # MuJoCo C compiles in no time, and scores as the others do


def run(arguments: argparse.Namespace) -> None:
    """Do what `hitmdp report` says; Raises UsageError as what it calls."""
    check_episodes(arguments.episodes)
    configs = {run_dir: RunConfig.load(run_dir, arguments.trust) for run_dir in arguments.run_dirs}
    first, one = arguments.run_dirs[0], len(configs) == 1
    other = None
    if arguments.env is not None:
        if not one:
            raise UsageError(
                "--env needs one RUN_DIR: a comparison shows each run in its own task."
            )
        other = on_task(configs[first], arguments.env).task_at(1)
    page = first / f"{file_name(Path(folder.REPORT).stem, arguments.env)}.html"
    out = arguments.out or (page if one else Path("comparison.html"))
    writable("--out", out)
    if one:
        set_up_host(ENGINE, 16 * arguments.episodes)
        write(first, configs[first], out, arguments.seed, arguments.episodes, other)
    else:
        from hitmdp_jax.experiments.pages import comparison_page

        runs = _named(configs)
        commands = {name: command_line(config) for name, (_, config) in runs.items()}
        films = {
            name: _Shown(run_dir, config, _median(run_dir, config), 1).video
            for name, (run_dir, config) in runs.items()
        }
        set_up_host(ENGINE, 16)
        with working("writing the report"):
            content = comparison_page(runs, commands, films)
        _save(content, out)


def write(
    run_dir: Path,
    config: RunConfig,
    out: Path | None = None,
    seed: int | None = None,
    episodes: int = EPISODES,
    other: Task | None = None,
) -> None:
    """Write the page about a run; args and Raises as `report`, `out` the file."""
    started = time.perf_counter()
    with working("writing the report"):
        content = report(run_dir, config, seed, episodes, other)
    _save(
        content, out or run_dir / folder.REPORT, f", made in {time.perf_counter() - started:.0f} s"
    )


def _save(content: str, path: Path, how: str = "") -> None:
    folder.made(path.parent)
    folder.write(path, content)
    print(f"Saved {path}: {len(content) / 2**20:.1f} MiB{how}.")


def report(
    run_dir: Path,
    config: RunConfig,
    seed: int | None = None,
    episodes: int = EPISODES,
    other: Task | None = None,
) -> str:
    """Return the page about a run.

    Args:
      run_dir: the run's folder.
      config: its settings.
      seed: whose options are shown; None takes the one with the median return.
      episodes: how many are recorded.
      other: another task that options and video are shown in; None is the one learned last.

    Raises:
      UsageError: the run has no such seed, or the policy does not fit the other task.
    """
    from hitmdp_jax.report.run_report import RunReport

    training = _median(run_dir, config) if seed is None else places(config.trainings, seed)[0]
    shown = _Shown(run_dir, config, training, episodes, other)
    if other is not None:
        check_fit(*shown.policy_and_env)  # or no section of the page would show that task
    named = None if other is None else other["name"]
    return RunReport(run_dir, config, command_line(config), training, shown, named).html()


class _Shown:
    """The policy of one training as its page shows it: loaded and played when that is asked for."""

    def __init__(
        self,
        run_dir: Path,
        config: RunConfig,
        training: int,
        episodes: int,
        other: Task | None = None,
    ):
        self.run_dir, self.config, self.other = run_dir, config, other
        self.training, self.episodes = training, episodes
        self.key = evaluation_key(config.trainings[training])

    @functools.cached_property
    def policy_and_env(self) -> tuple[Policy, Any]:
        iteration, everyone = load_all(self.run_dir)
        own = self.config.trainings[self.training]
        task = self.other or self.config.task_at(iteration, own)
        engine = engine_for(task["name"], ENGINE)
        return everyone.of(self.training), task_env(task, engine)

    @functools.cached_property
    def analysis(self) -> "OptionAnalysis":
        """Its options in recorded episodes; raises UsageError where it has none."""
        from hitmdp_jax.interpret.option_analysis import OptionAnalysis
        from hitmdp_jax.interpret.option_use import number_of_options

        number_of_options(self.config.make_agent())  # before anything is compiled
        policy, env = self.policy_and_env
        return OptionAnalysis(policy, env, self.key, self.episodes)

    def analyse(self) -> "OptionAnalysis":
        """Return the analysis; raises as it does."""
        return self.analysis

    def recorded(self) -> Trajectories:
        """Return the episodes that the page speaks of; one of a policy without options."""
        try:
            return self.analysis.trajectories
        except UsageError:
            policy, env = self.policy_and_env
            return jax.device_get(run_episodes(policy, env, self.key, 1, physics=True))

    def filmed_env(self) -> Any:
        """Return the task; raises UsageError where it cannot be filmed."""
        from hitmdp_jax.cli.video import check_filming

        _, env = self.policy_and_env
        check_filming(env, (self.other or self.config.tasks[-1])["name"])
        return env

    def video(self, path: Path) -> None:
        """Film the beginning of the first episode."""
        from hitmdp_jax.video.film import write_video

        env = self.filmed_env()
        shown = _beginning(self.recorded(), FILMED, spec_of(env).dt)
        write_video(path, env, shown, episodes=[0], size=PIXELS)

    def clips(self, options: Sequence[int], paths: Sequence[Path]) -> None:
        """Film how the first episode begins when each of these options acts alone."""
        from hitmdp_jax.video.film import write_clips

        env = self.filmed_env()
        alone = self.analysis.interventions.alone
        films = [jax.tree.map(lambda x, k=k: x[k], alone) for k in options]
        dt = spec_of(env).dt
        write_clips(paths, env, [_beginning(film, CLIPPED, dt) for film in films])

    def poses(self) -> Mapping[int, np.ndarray]:
        """Draw the body at a typical state of each option."""
        from hitmdp_jax.video.filmstrip import poses

        return poses(self.analysis)


def _beginning(recorded: Trajectories, seconds: float, dt: float | None) -> Trajectories:
    """Return how episodes begin.

    Args:
      recorded: the episodes.
      seconds: how long; a step of a task without a clock counts as 1/20 s.
      dt: seconds that a control step takes; None of a task without a clock.
    """
    steps = np.arange(len(recorded.alive)) < seconds / (dt or 1 / 20)
    return recorded.replace(alive=np.asarray(recorded.alive) & steps[:, None])


def _median(run_dir: Path, config: RunConfig) -> int:
    """Return the place of the training with the median return, in a sweep of the best setting.

    It is the first one where no return is known.
    """
    from hitmdp_jax.interpret.returns import final_returns
    from hitmdp_jax.interpret.summary import rank
    from hitmdp_jax.runs.metrics import read_metrics

    if not (run_dir / folder.METRICS).is_file():
        return 0
    metrics = read_metrics(run_dir, len(config.trainings))
    if not metrics:
        return 0
    returns = final_returns(metrics, config.switch_at)
    best = next(iter(rank(config, metrics).values()))
    candidates = np.array(places(config.trainings, setting=best.setting))
    known = candidates[np.isfinite(returns[candidates])]
    return int(known[np.argsort(returns[known])[(len(known) - 1) // 2]]) if known.size else 0


def _named(configs: dict[Path, RunConfig]) -> dict[str, tuple[Path, RunConfig]]:
    """Return runs by algorithm, or by folder where two have the same one."""
    algos = [config.algo["name"] for config in configs.values()]
    unique = len(set(algos)) == len(algos)
    return {
        algo if unique else str(run_dir): (run_dir, config)
        for algo, (run_dir, config) in zip(algos, configs.items(), strict=True)
    }
