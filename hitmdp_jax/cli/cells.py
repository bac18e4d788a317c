"""The cells of an experiment, an arm on a task each: trained, scored and published."""

import dataclasses
import datetime
import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from hitmdp_jax import plugins
from hitmdp_jax.agents import find_agent
from hitmdp_jax.cli.arms import configs_of, named, train_into
from hitmdp_jax.cli.published import TRUST, Places, draw, read_cells, report, tell
from hitmdp_jax.cli.run_settings import folder_setting, writable
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.experiments import experiment as catalogue
from hitmdp_jax.experiments import published
from hitmdp_jax.experiments.experiment import Experiment, last_of_each
from hitmdp_jax.experiments.results_page import section
from hitmdp_jax.interpret import interventions
from hitmdp_jax.interpret.returns import length_warning, median_speed
from hitmdp_jax.interpret.summary import EPISODES, Summary, summarize
from hitmdp_jax.runs.config import RunConfig, trust_named
from hitmdp_jax.runs.folder import POLICY
from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.runs.policy import load
from hitmdp_jax.runs.provenance import made_with
from hitmdp_jax.runs.saving import extract

CHOICE_EPISODES = 8
OWN = ("tasks", "arms", "results", "page", "run_dir")  # beside the settings of train.py
TELLERS = {"results": report, "curves": draw}  # what takes the place of an experiment's name


def run(name: str, arguments: list[str]) -> int:
    """Train and publish an experiment's cells, or tell of what is published; return the exit code.

    Args:
      name: the experiment's, or one of `TELLERS`.
      arguments: as `hitmdp experiment --help` says.

    Raises:
      UsageError: a setting is wrong, a folder holds something else, or a run failed.
    """
    if name in TELLERS:
        return TELLERS[name](arguments)
    trust, arguments = TRUST in arguments, [text for text in arguments if text != TRUST]
    given = named(arguments)
    settings = [text for text in arguments if text.split("=", 1)[0] not in OWN]
    whole = catalogue.read(name)
    experiment = _chosen(whole, given, settings)
    ours = not name.endswith(".yaml")
    values = Settings(settings).values()
    trust_named(values, remember=True)
    run_dir = folder_setting(given) or Path("runs", "experiments", Path(name).stem)
    places = Places.of(given, run_dir, experiment.published)
    cells = {
        (task, arm): experiment.settings_of(task, arm, settings)
        for task in experiment.tasks
        for arm in experiment.arms
    }
    # All are checked before the first is trained.
    every = configs_of({f"{task}/{arm}": x for (task, arm), x in cells.items()}, ours or trust)
    configs = dict(zip(cells, every.values(), strict=True))
    for task in experiment.tasks:
        of_task = {arm: configs[task, arm].schedule.env_steps for arm in experiment.arms}
        if warning := length_warning(of_task):
            print(f"{task}: {warning}")
    known = read_cells(places.results, experiment.tasks, trust)
    wanted = [x for x in cells if not _is_there(places.results, known, *x, configs[x])]
    for cell in wanted:
        configs[cell].check_installed()
    writable("run_dir", run_dir, "x")
    for task, arm in wanted:
        with_policy = arm in experiment.policies
        training = Training(run_dir, task, arm, cells[task, arm], configs[task, arm], with_policy)
        if code := training.make(places.results, ours or trust):
            return code
        tell({name: _joined(whole, experiment)}, places)
        print(f"{task}/{arm}: published in {places.results / task}", flush=True)
    print(section(name, experiment, read_cells(places.results, experiment.tasks, trust)))
    return 0


def _chosen(experiment: Experiment, given: dict[str, str], settings: list[str]) -> Experiment:
    """Return the part of an experiment that a command line names.

    Raises:
      UsageError: a name is unknown, or a setting would make all arms the same.
    """
    for name in set(named(settings)) & {"algo", "resume", "sweep"}:
        raise UsageError(f"experiment takes no {name}=: its arms say what is compared.")
    tasks, arms = experiment.tasks, experiment.arms
    if not tasks:
        words = named(last_of_each([*experiment.settings, *settings]))
        label = plugins.label(words.get("pair", words.get("env", "halfcheetah")))
        tasks = {label.replace("/", "-"): []}
    if "arms" in given:
        listed = given["arms"].split(",")
        for text in listed:
            plugins.require_class(text)
        own = [text for text in listed if plugins.is_own(text)]
        for algo in own:
            plugins.trust(algo, remember=True)
            find_agent(algo)
        arms = arms | {plugins.label(algo): [f"algo={algo}"] for algo in own}
        arms = _part("arm", [plugins.label(x) if x in own else x for x in listed], arms)
    if "tasks" in given:
        tasks = _part("task", given["tasks"].split(","), tasks)
    return dataclasses.replace(experiment, tasks=tasks, arms=arms)


def _joined(whole: Experiment, part: Experiment) -> Experiment:
    """Return an experiment with the tasks and arms that a command line added."""
    return dataclasses.replace(whole, tasks=whole.tasks | part.tasks, arms=whole.arms | part.arms)


def _part(kind: str, chosen: Sequence[str], known: dict[str, list[str]]) -> dict[str, list[str]]:
    for name in chosen:
        if name not in known:
            raise unknown_name(kind, name, known)
        if chosen.count(name) > 1:
            raise UsageError(f"{kind}s = {','.join(chosen)} names {name} more than once.")
    return {name: known[name] for name in chosen}


def _is_there(
    results: Path, cells: published.Cells, task: str, arm: str, config: RunConfig
) -> bool:
    """Return whether a cell is published with at least the seeds that are asked for.

    Raises:
      UsageError: it is of other settings.
    """
    cell = cells[task].get(arm)
    if cell is None:
        return False
    if differences := cell.stands_for(config):
        raise UsageError(
            f"{arm} in '{results / task}' was published with other settings "
            f"({'; '.join(differences)}): give another results=."
        )
    return cell.summary.config.seeds >= config.seeds


@dataclasses.dataclass(frozen=True)
class Training:
    """The training of a cell, from its settings to what is published."""

    folder: Path  # of all trainings
    task: str
    arm: str
    settings: list[str]
    config: RunConfig
    with_policy: bool

    def make(self, results: Path, trust: bool) -> int:
        """Train the seeds that are not published yet and publish them; return the exit code."""
        known = published.read(results / self.task).get(self.arm)
        if known and known.summary.swept:  # its seeds are not the last of its trainings
            known = None
        first = known.summary.config.seeds if known else 0
        seed, seeds = self.config.seed + first, self.config.seeds - first
        missing = last_of_each([*self.settings, f"seeds={seeds}", f"seed={seed}"])
        run_dir = self.folder / self.task / f"{self.arm}-{seed}-{seeds}"
        if code := train_into(run_dir, missing, trust):
            return code
        new = finished(run_dir, missing)
        cell = known.followed_by(new) if known else new

        def add_policy(folder: Path) -> None:
            best = cell.summary.config.trainings[_best(cell.summary)]
            # Otherwise it is one of the seeds that were published before, as is its policy.
            if best in new.summary.config.trainings:
                file = folder / f"{self.arm}{POLICY}"
                extract(run_dir, file, best.seed, setting=best.setting)

        more = [add_policy] if self.with_policy else []
        published.publish(cell, results / self.task, self.arm, *more)
        return 0


def _best(run: Summary) -> int:
    return int(np.nanargmax(run.columns["evaluation"]))


def finished(run_dir: Path, settings: Sequence[str]) -> published.Cell:
    """Return the results of a finished run that are kept, after its policies are scored."""
    config = RunConfig.load(run_dir)
    metrics = read_metrics(run_dir, len(config.trainings))
    run = summarize(config, metrics)
    parameters = sum(x.size for x in jax.tree.leaves(load(run_dir, config.seed).params))
    counted = np.full(len(config.trainings), float(parameters))
    about = {
        "command": shlex.join(["python", "train.py", *settings]),
        "day": datetime.date.today().isoformat(),
        "with": made_with(run_dir),
        "hours": round(run.env_steps / median_speed(metrics) / 3600, 2),
    }
    columns = run.columns | {"parameters": counted} | evaluated(run_dir, config)
    return published.Cell(Summary(config, columns, about), published.curves_of(config, metrics))


def evaluated(run_dir: Path, config: RunConfig) -> dict[str, np.ndarray]:
    """Return how the policies of a run score, [R] each.

    The deterministic ones over `EPISODES` episodes; where there are options to choose from, the
    training ones over `CHOICE_EPISODES` under other choices (`interpret.interventions.summary`).
    """
    names = {"evaluation": "return", "evaluation_std": "std"}
    rows = _evaluate(run_dir, "--deterministic", "--episodes", str(EPISODES))
    columns = {name: np.array([row[column] for row in rows]) for name, column in names.items()}
    if config.algo.get("num_options", 1) > 1 and not config.sweep:
        rows = _evaluate(run_dir, "--choices", "--episodes", str(CHOICE_EPISODES))
        choices = (*interventions.OF_CHOICES, *interventions.OF_OPTIONS)
        columns |= {name: np.array([row[name] for row in rows]) for name in choices}
    return columns


def _evaluate(run_dir: Path, *flags: str) -> list[dict[str, Any]]:
    command = [sys.executable, "-m", "hitmdp_jax", "evaluate", str(run_dir), "--json", "--trust"]
    command += flags
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
