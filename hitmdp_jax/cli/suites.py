"""The paper's tables, and other fixed sets of runs: trained, published, and told of on one page."""

import contextlib
import datetime
import functools
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import hitmdp_jax
from hitmdp_jax.cli.arms import configs_of, last_of_each, named, train_arms
from hitmdp_jax.cli.settings import writable
from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.experiments import results, results_figure, used_options
from hitmdp_jax.experiments.results_page import Suite, page, section
from hitmdp_jax.figures.curves import save
from hitmdp_jax.interpret import interventions
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import CONFIG, write
from hitmdp_jax.runs.provenance import made_with
from hitmdp_jax.runs.saving import extract

SUITES = Path(hitmdp_jax.__file__).parent / "suites"
RUNS = Path("runs/results")
CHOICE_EPISODES = 8
# What a suite's command line names beside the settings of train.py.
OWN = {"tasks": "all", "arms": "all", "results": "results", "page": "docs/results.md"}
TRUST = "--trust"


def names() -> list[str]:
    """Return the suites that come with the package, in the order of the page."""
    order = ["table1", "table2", "table3", "figure11", "options"]
    found = sorted(path.stem for path in SUITES.glob("*.yaml"))
    return sorted(found, key=lambda name: order.index(name) if name in order else len(order))


def read(name: str) -> Suite:
    """Return a suite that comes with the package."""
    return Suite(**yaml.safe_load((SUITES / f"{name}.yaml").read_text()))


def run_suite(name: str, arguments: Sequence[str]) -> int:
    """Train, or go on with, whatever seeds are not published yet; return the exit code.

    Args:
      name: the suite's.
      arguments: `tasks=`, `arms=`: which of its cells; `results=`, `page=`: where to; and settings
        of train.py, for every run.

    Raises:
      UsageError: a setting is wrong, a published cell is of other settings, or a run failed.
    """
    suite, (own, settings) = read(name), _own(arguments)
    tasks = _chosen("task", own["tasks"], suite.tasks)
    arms = _chosen("arm", own["arms"], suite.arms)
    folder, path = _checked(own["results"], own["page"], TRUST in arguments)
    commands = {
        f"{task}/{arm}": last_of_each([*suite.settings_of(task, arm), *settings])
        for task in tasks
        for arm in arms
    }
    # All are checked before the first is trained.
    configs = configs_of(commands)
    wanted = [cell for cell, config in configs.items() if not _is_there(folder / cell, config)]
    for cell in wanted:
        configs[cell].check_installed()
    for cell in wanted:
        known = results.read(folder / cell)
        if known and known.swept:  # its seeds are not the last of its trainings
            known = None
        first = known.config.seeds if known else 0
        seed, seeds = configs[cell].seed + first, configs[cell].seeds - first
        missing = last_of_each([*commands[cell], f"seeds={seeds}", f"seed={seed}"])
        run_dir = RUNS / f"{cell}-{seed}-{seeds}"
        if code := train_arms({run_dir.name: missing}, run_dir.parent):
            return code
        about = {
            "command": shlex.join(["python", "train.py", *missing]),
            "day": datetime.date.today().isoformat(),
            "with": made_with(run_dir),
        }
        scores, with_policy = (
            evaluated(run_dir, configs[cell]),
            cell.split("/")[1] in suite.policies,
        )
        more = functools.partial(publish_more, run_dir, with_policy=with_policy)
        results.publish(run_dir, folder / cell, scores, about, known, more)
        tell(folder, path)
        print(f"{cell}: published in {folder / cell}", flush=True)
    print(section(name, suite, folder, str(folder)))
    return 0


def run_figure(suites: Sequence[str], arguments: Sequence[str]) -> int:
    """Run the suites whose curves a figure of the paper shows; return the exit code.

    Args:
      suites: their names.
      arguments: as those of `run_suite`; `tasks=` of any of them.

    Raises:
      UsageError: as `run_suite`.
    """
    tasks = {name: read(name).tasks for name in suites}
    every = {task: None for of_suite in tasks.values() for task in of_suite}
    chosen = _chosen("task", _own(arguments)[0]["tasks"], every)
    for name in suites:
        mine = ",".join(task for task in chosen if task in tasks[name])
        if mine and (code := run_suite(name, last_of_each([*arguments, f"tasks={mine}"]))):
            return code
    return 0


def publish_more(run_dir: Path, folder: Path, with_policy: bool) -> None:
    """Draw what a published sweep found, or keep the policy whose deterministic episodes are best.

    Args:
      run_dir: the run's folder.
      folder: the cell's.
      with_policy: whether to keep the policy; it comes from the newest checkpoint, as scored.
    """
    cell = results.read(folder)
    assert cell is not None
    if cell.swept:
        drawn = used_options.figure(cell.seeds, cell.swept, cell.num_options)
        save(drawn, folder / results.DRAWING)
    if with_policy:
        best = cell.config.trainings[int(np.nanargmax(cell.seeds["evaluation"]))]
        # Otherwise it is one of the seeds that were published before, as is its policy.
        if best in RunConfig.load(run_dir).trainings:
            shutil.rmtree(folder / results.POLICY, ignore_errors=True)
            extract(run_dir, folder / results.POLICY, best.seed, setting=best.setting)


def report(arguments: Sequence[str]) -> int:
    """Write the page of everything that is published; Raises as `_places`."""
    folder, path = _places(arguments, OWN["page"])
    tell(folder, path)
    print(f"Written: {path}.")
    return 0


def draw(arguments: Sequence[str]) -> int:
    """Write a page of all curves that are published; Raises as `_places`."""
    # Imported here: Plotly takes as long to import as the rest of the command.
    from hitmdp_jax.experiments.results_curves import curves_page

    folder, path = _places(arguments, "results.html")
    write(path, curves_page({name: read(name) for name in names()}, folder))
    print(f"Written: {path}.")
    return 0


def _places(arguments: Sequence[str], page: str) -> tuple[Path, Path]:
    """Return the folder of what is published, and where a page of it goes.

    Raises:
      UsageError: an argument is neither `results=` nor `page=`.
    """
    given = {"results": OWN["results"], "page": page}
    for text in arguments:
        if text.split("=", 1)[0] not in (*given, TRUST):
            raise unknown_name("setting", text.split("=", 1)[0], given)
    given |= named(arguments)
    return _checked(given["results"], given["page"], TRUST in arguments)


def _checked(folder: str, page: str, trust: bool) -> tuple[Path, Path]:
    """Return the two as paths; Raises UsageError where they cannot be written, before hours.

    With `trust`, the files that the published settings name may be run from now on.
    """
    for path in Path(folder).rglob(CONFIG) if trust else ():
        with contextlib.suppress(UsageError):  # which whatever reads it raises again
            RunConfig.load(path.parent, trust=True)
    return writable("results", Path(folder), "table1.png"), writable("page", Path(page))


def tell(folder: Path, path: Path) -> None:
    """Draw the curves of each suite's published cells beside them, and write the page of them."""
    every = {name: read(name) for name in names()}
    for name, suite in every.items():
        curves = folder / f"{name}.png"
        if drawn := results_figure.figure(suite, folder):
            save(drawn, curves, dpi=100)
        else:
            curves.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    link = Path(os.path.relpath(folder, path.parent)).as_posix()
    write(path, page(every, folder, link))


def evaluated(run_dir: Path, config: RunConfig) -> dict[str, np.ndarray]:
    """Return how the policies of a run score, [R] each.

    The deterministic ones over `EPISODES` episodes; where there are options to choose from, the
    training ones over `CHOICE_EPISODES` under other choices (`interpret.interventions.summary`).
    """
    names = {"evaluation": "return", "evaluation_std": "std"}
    rows = _evaluate(run_dir, "--deterministic", "--episodes", str(results.EPISODES))
    columns = {name: np.array([row[column] for row in rows]) for name, column in names.items()}
    if config.algo.get("num_options", 1) > 1 and not config.sweep:
        rows = _evaluate(run_dir, "--choices", "--episodes", str(CHOICE_EPISODES))
        choices = (*interventions.OF_CHOICES, *interventions.OF_OPTIONS)
        columns |= {name: np.array([row[name] for row in rows]) for name in choices}
    return columns


def _evaluate(run_dir: Path, *flags: str) -> list[dict[str, float]]:
    command = [sys.executable, "-m", "hitmdp_jax", "evaluate", str(run_dir), "--json", "--trust"]
    command += flags
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def _own(arguments: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Return a suite's own settings, and the other arguments."""
    given = named(arguments)
    rest = [text for text in arguments if text.split("=", 1)[0] not in (*OWN, TRUST)]
    return {name: given.get(name, default) for name, default in OWN.items()}, rest


def _chosen(kind: str, listed: str, known: dict[str, Any]) -> list[str]:
    chosen = list(known) if listed == "all" else listed.split(",")
    for name in chosen:
        if name not in known:
            raise unknown_name(kind, name, known)
    return chosen


def _is_there(folder: Path, config: RunConfig) -> bool:
    """Return whether a cell is published with at least the seeds that are asked for.

    Raises:
      UsageError: it is of other settings.
    """
    cell = results.read(folder)
    if cell is None:
        return False
    if differences := cell.stands_for(config):
        raise UsageError(
            f"'{folder}' was published with other settings ({'; '.join(differences)}): remove it, "
            "or name another results=."
        )
    return cell.config.seeds >= config.seeds


TARGETS: dict[str, Callable[[list[str]], int]] = {
    **{name: lambda arguments, name=name: run_suite(name, arguments) for name in names()},
    # As sec. 4 and App. B.1 draw them: single tasks without an end and with one, and transfer.
    "figure3": functools.partial(run_figure, ("table1", "table2")),
    "figure4": functools.partial(run_figure, ("table3",)),
    "results": report,
    "curves": draw,
}
