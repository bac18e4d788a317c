"""Score a trained run, or one that is training."""

import argparse
import csv
import io
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from hitmdp_jax import plugins
from hitmdp_jax.cli.policies import evaluation_key, load_config, load_named, on_task
from hitmdp_jax.cli.waiting import working
from hitmdp_jax.envs.base import has_model
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.experiments.tables import show
from hitmdp_jax.interpret.evaluation import (
    Scores,
    check_fit,
    check_request,
    score_each,
    task_env,
)
from hitmdp_jax.interpret.interventions import WITHOUT_EACH_OPTION, summary
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.option_use import number_of_options
from hitmdp_jax.reading import read_rows
from hitmdp_jax.runs.callbacks import learned
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.config import RunConfig, Task
from hitmdp_jax.runs.folder import EVALUATIONS, alone, is_policy, write
from hitmdp_jax.runs.host import set_up_host, solver_of
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.policy import places
from hitmdp_jax.runs.sinks.csv import kept_aside
from hitmdp_jax.training.sweep import PREFIX, Training, numbers_of

OWN = "own"  # in the column `engine`: a task that brings its own physics
COLUMNS: tuple[str, ...] = (
    "iteration", "task", "seed", "engine", "episodes", "deterministic",
    "return", "std", "min", "max", "std_error", "length",
)  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Do what `hitmdp evaluate` says; Raises UsageError as what it calls."""
    config = on_task(load_config(arguments), arguments.env)
    chosen = places(config.trainings, arguments.seed, arguments.setting)
    engine = config.physics if arguments.engine is None else arguments.engine
    check_request(engine, arguments.episodes)
    side_by_side = arguments.episodes * len(chosen)
    if arguments.choices:
        if engine == "gymnasium":
            raise UsageError("--choices needs an engine of JAX: one of native, mjx, warp.")
        number = number_of_options(config.make_agent())
        side_by_side = max(side_by_side, arguments.episodes * (number + WITHOUT_EACH_OPTION))
    stepped = engine if engine != "gymnasium" else config.physics
    set_up_host(solver_of(config, stepped), side_by_side)
    iteration, everyone = load_named(arguments)
    trainings = [config.trainings[place] for place in chosen]
    keys = [evaluation_key(training) for training in trainings]
    policies, task = everyone.of(np.array(chosen)), config.task_at(iteration)
    if arguments.env is not None:  # Gymnasium would not say
        check_fit(everyone.of(0), task_env(task, stepped))
    deterministic = arguments.deterministic
    numbers = {} if arguments.env is not None else numbers_of(trainings)  # of another task: its own
    with working("playing episodes"):
        scores = score_each(
            policies, task, engine, arguments.episodes, keys, deterministic, numbers
        )
    simulator = simulated_by(task, engine)
    rows = rows_of(scores, iteration, task, trainings, simulator, deterministic)
    choices = []
    if arguments.choices:
        for i, key in enumerate(keys):
            own = {name: float(x[i]) for name, x in numbers.items()}
            env = task_env(task | own, engine)
            with working("playing episodes with other choices of options"):
                analysis = OptionAnalysis(policies.of(i), env, key, arguments.episodes)
                choices.append(summary(analysis.interventions))
    if arguments.json:
        both = itertools.zip_longest(rows, choices, fillvalue={})
        print(json.dumps([entry | choice for entry, choice in both], indent=2))
    else:
        where = "its own physics" if simulator == OWN else simulator
        title = f"{plugins.label(task['name'])} in {where}"
        _show(title, list(trainings[0].columns), rows, choices)
    _note(arguments.run_dirs[0], rows)


def simulated_by(task: Task, engine: str) -> str:
    """Return the engine that simulated a task, or `OWN` if the task has its own physics."""
    return engine if engine == "gymnasium" or has_model(task_env(task, engine)) else OWN


def _show(
    title: str, index: list[str], rows: list[dict[str, Any]], choices: list[dict[str, float]]
) -> None:
    """Print the scores, and those under other choices of options where there are any."""
    numbers = ["return", "std", "min", "max", "std error", "length"]
    numbers += ["success"] if "success" in rows[0] else []
    table = [[*(name.removeprefix(PREFIX) for name in index), *numbers]]
    for entry in rows:
        numbers = [entry[name] for name in ("return", "std", "min", "max", "std_error")]
        shown = ("-" if x is None else f"{x:,.1f}" for x in numbers)
        more = [f"{entry['length']:.1f}"]
        more += [f"{entry['success']:.0%}"] if "success" in entry else []
        table.append([*(f"{entry[name]:.6g}" for name in index), *shown, *more])
    show(table, title)
    if choices:
        table = [["seed", *choices[0]]]
        for entry, choice in zip(rows, choices, strict=True):
            table.append([str(entry["seed"]), *(f"{x:,.1f}" for x in choice.values())])
        show(table, "by choice of options")


def rows_of(
    scores: Sequence[Scores],
    iteration: int,
    task: Task,
    trainings: Sequence[Training],
    engine: str,
    deterministic: bool,
) -> list[dict[str, Any]]:
    """Return the scores of the trainings as rows, one per training."""
    rows = []
    for of_one, training in zip(scores, trainings, strict=True):
        returns, error = of_one.returns, of_one.standard_error
        numbers = (returns.mean(), returns.std(), returns.min(), returns.max())
        values = (
            iteration, plugins.label(task["name"]), training.seed, engine, len(returns),
            deterministic, *(float(x) for x in numbers), None if np.isnan(error) else error,
            float(of_one.lengths.mean()),
        )  # fmt: skip
        known = {} if of_one.success is None else {"success": float(of_one.success.mean())}
        rows.append(dict(zip(COLUMNS, values, strict=True)) | training.columns | known)
    return rows


def append(run_dir: Path, rows: list[dict[str, Any]]) -> None:
    """Add rows to the run's evaluations.csv, whose columns become those of all rows.

    An older version left out some, and a transfer's second task may know of success alone.
    """
    path = run_dir / EVALUATIONS
    with alone(run_dir):
        known = _known(path) if path.exists() else []
        columns = dict.fromkeys(name for one in (*rows[:1], *known[:1]) for name in one)
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, columns, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows([*known, *rows])
        write(path, text.getvalue())


def _known(path: Path) -> list[dict[str, str]]:
    """Return the rows of a file; one that is damaged is kept aside, and that is said."""
    try:
        return [row for _, row in read_rows(path)]
    except UsageError as error:
        aside = kept_aside(path)
        warn(f"{error} {aside.name} beside it keeps the damaged file.")
        return []


def _note(run_dir: Path, rows: list[dict[str, Any]]) -> None:
    """Append rows, or say why that cannot be done: the scores themselves are known.

    A policy's file takes none.
    """
    if is_policy(run_dir):
        return
    try:
        append(run_dir, rows)
    except OSError as error:
        warn(f"the scores could not be written to '{error.filename}': {error.strerror}.")


class Evaluation:
    """Scores every policy while a run trains: whole episodes of the deterministic one.

    In a transfer they are episodes of the task that the run is on.

    Args:
      config: the run's settings, `eval_every` and `eval_episodes` among them.
      run_dir: the run's folder; every score is a row of its evaluations.csv.
    """

    names = ("evaluation_return",)

    def __init__(self, config: RunConfig, run_dir: Path):
        self.every = config.eval_every
        self._config, self._run_dir = config, run_dir

    def __call__(self, progress: Progress, env_steps: int) -> dict[str, np.ndarray]:
        """Return the mean return of each training [R]."""
        config = self._config
        everyone = learned(config, progress)
        keys = [
            jax.random.fold_in(evaluation_key(training), progress.iteration)
            for training in config.trainings
        ]
        task, numbers = config.task_at(progress.iteration), numbers_of(config.trainings)
        episodes = config.eval_episodes
        scores = score_each(everyone, task, config.physics, episodes, keys, True, numbers)
        engine = simulated_by(task, config.physics)
        rows = rows_of(scores, progress.iteration, task, config.trainings, engine, True)
        _note(self._run_dir, rows)
        return {"evaluation_return": np.array([entry["return"] for entry in rows])}

    def close(self, stop: StopRequest) -> None:
        """Nothing is under way between two calls."""
