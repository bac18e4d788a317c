"""Published results: what is kept of finished runs, small enough to lie in the repository.

A task is a folder, `results/<task>`, and each arm that was trained on it a part of its files:
  seeds.csv     one row per training: its final returns, evaluation and use of options
  curves.csv    the returns while it trained, at `POINTS` points; one column per training
  runs.yaml     the settings, the command, the day, versions, hours
  <arm>.policy  that of the seed whose deterministic episodes are best, as they were scored
An arm is published once, whichever experiments show it.
"""

import contextlib
import csv
import dataclasses
import io
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

from hitmdp_jax.interpret.returns import mean_return
from hitmdp_jax.interpret.summary import Columns, Summary
from hitmdp_jax.reading import read_numbers, read_yaml, unreadable
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import write
from hitmdp_jax.runs.metrics import Metrics

POINTS = 100  # of a published curve
SEEDS, CURVES, RUNS = "seeds.csv", "curves.csv", "runs.yaml"
BOTH = "; "  # between what is told of two runs that share a cell
ALWAYS = ("seed", "env_steps", "last_100k_steps")  # known of every training


@dataclasses.dataclass(frozen=True)
class Cell:
    """What was published of one arm on one task."""

    summary: Summary
    curves: Columns  # `env_steps` and `episode_return`, [R, points] each

    def stands_for(self, config: RunConfig) -> list[str]:
        """Return how the cell's settings differ from these; more seeds are no difference."""
        mine = self.summary.config
        seeds = min(config.seeds, mine.seeds)
        return dataclasses.replace(config, seeds=seeds).differences(
            dataclasses.replace(mine, seeds=seeds)
        )

    def followed_by(self, more: "Cell") -> "Cell":
        """Return the cell that all seeds at once would have made; `more` has those that follow."""
        first, second = self.summary, more.summary
        columns = {
            name: np.concatenate([first.columns.get(name, np.full(len(first.returns), np.nan)), x])
            for name, x in second.columns.items()
        }
        both = first.config.seeds + second.config.seeds
        config = dataclasses.replace(second.config, seed=first.config.seed, seeds=both)
        about = {
            name: x if first.about[name] == x else f"{first.about[name]}{BOTH}{x}"
            for name, x in second.about.items()
        }
        about["hours"] = round(first.about["hours"] + second.about["hours"], 2)
        curves = {name: np.concatenate([x, more.curves[name]]) for name, x in self.curves.items()}
        return Cell(Summary(config, columns, about), curves)


Cells = Mapping[str, Mapping[str, Cell]]  # by task and arm


def publish(
    cell: Cell, folder: Path, arm: str, more: Callable[[Path], None] = lambda folder: None
) -> None:
    """Write a cell, in place of what the folder held of the arm.

    A kill at any moment leaves the old folder or the new one, which is always whole.

    Args:
      cell: what is kept.
      folder: the task's.
      arm: the name that it has there.
      more: adds further files to the folder that it is given, which becomes the task's.
    """
    settings = yaml.safe_load(cell.summary.config.to_yaml())
    with _replacing(folder) as beside:
        cells = read(beside) | {arm: cell}
        told = read_yaml(beside / RUNS) if len(cells) > 1 else {}
        told[arm] = dict(cell.summary.about) | {"config": settings}
        _write_seeds(beside / SEEDS, {name: x.summary.columns for name, x in cells.items()})
        _write_curves(beside / CURVES, {name: x.curves for name, x in cells.items()})
        write(beside / RUNS, yaml.safe_dump(told, sort_keys=False, allow_unicode=True))
        more(beside)


@contextlib.contextmanager
def _replacing(folder: Path) -> Iterator[Path]:
    """Give a copy of a folder, which takes its place at the end."""
    beside, old = (folder.with_name(f".{folder.name}.{name}") for name in ("new", "old"))
    _settle(folder)
    for leftover in (beside, old):
        shutil.rmtree(leftover, ignore_errors=True)
    if folder.exists():
        shutil.copytree(folder, beside)
    else:
        beside.mkdir(parents=True)
    yield beside
    if folder.exists():
        os.replace(folder, old)
    os.replace(beside, folder)
    shutil.rmtree(old, ignore_errors=True)


def _settle(folder: Path) -> None:
    """Bring a folder back of which a kill came between the old one's leaving and the new one."""
    old = folder.with_name(f".{folder.name}.old")
    if old.exists() and not folder.exists():
        os.replace(old, folder)


def read(folder: Path, trust: bool = False) -> dict[str, Cell]:
    """Return the published results of a task by arm; empty if there are none.

    Args:
      folder: the task's.
      trust: run the files of tasks and algorithms that its settings name.

    Raises:
      UsageError: it cannot be read, or names a file that nobody here trusts.
    """
    _settle(folder)
    if not (folder / RUNS).exists():
        return {}
    told = read_yaml(folder / RUNS)
    if not isinstance(told, dict) or not all(isinstance(x, dict) for x in told.values()):
        raise unreadable(folder / RUNS, "it does not tell of runs")
    seeds = _rows_by_arm(folder / SEEDS, ALWAYS)
    curves = _rows_by_arm(folder / CURVES, ("env_steps",))
    cells = {}
    for arm, about in told.items():
        config = RunConfig.read(about.pop("config", None), folder / RUNS, trust)
        if missing := [path for path, x in ((SEEDS, seeds), (CURVES, curves)) if arm not in x]:
            raise unreadable(folder / missing[0], f"it holds no rows of {arm}")
        columns = {name: np.array([row[name] for row in seeds[arm]]) for name in seeds[arm][0]}
        known = {n: x for n, x in columns.items() if n in ALWAYS or not np.isnan(x).all()}
        summary = Summary(config, known, about)
        cells[str(arm)] = Cell(summary, _curves_of(curves[arm], len(summary.returns)))
    return cells


def _rows_by_arm(path: Path, needed: Iterable[str]) -> dict[str, list[dict[str, float]]]:
    """Return the rows of a table, all numbers but the arm that they are of."""
    rows: dict[str, list[dict[str, float]]] = {}
    for row in read_numbers(path, ("arm", *needed), words=("arm",)):
        rows.setdefault(str(row.pop("arm")), []).append(row)
    return rows


def _curves_of(rows: Sequence[Mapping[str, float]], trainings: int) -> Columns:
    """Return curves as `read_metrics` gives those of a run: [R, points] each."""
    steps = np.array([row["env_steps"] for row in rows])
    names = map(str, range(1, trainings + 1))
    returns = np.array([[row.get(name, np.nan) for row in rows] for name in names])
    return {"env_steps": np.tile(steps, (trainings, 1)), "episode_return": returns}


def curves_of(config: RunConfig, metrics: Metrics) -> Columns:
    """Return the mean return of the episodes that ended before each of `POINTS` points.

    It is NaN where none ended since the point before. No point holds episodes of two tasks: where a
    transfer switches, one ends.

    Args:
      config: the run's settings.
      metrics: as `read_metrics` gives them.

    Returns:
      `env_steps` and `episode_return`, [R, points] each.
    """
    steps = metrics["env_steps"][0]
    switch = np.searchsorted(steps, config.switch_at or 0, side="right")
    parts = [
        part
        for of_task in np.split(np.arange(len(steps)), [switch])
        for part in np.array_split(of_task, max(1, round(POINTS * len(of_task) / len(steps))))
        if len(part)
    ]
    returns = [mean_return(metrics, part) for part in parts]
    ends = [part[-1] for part in parts]
    return {"env_steps": metrics["env_steps"][:, ends], "episode_return": np.stack(returns, axis=1)}


def _write_seeds(path: Path, cells: Mapping[str, Columns]) -> None:
    columns = list(dict.fromkeys(name for cell in cells.values() for name in cell))
    rows = [
        [arm, *(_text(cell[name][i]) if name in cell else "" for name in columns)]
        for arm, cell in cells.items()
        for i in range(len(cell["seed"]))
    ]
    _write(path, [["arm", *columns], *rows])


def _write_curves(path: Path, cells: Mapping[str, Columns]) -> None:
    most = max(len(cell["env_steps"]) for cell in cells.values())
    rows = []
    for arm, cell in cells.items():
        for steps, returns in zip(cell["env_steps"][0], cell["episode_return"].T, strict=True):
            known = [_text(steps), *map(_text, returns)]
            rows.append([arm, *known, *[""] * (most - len(returns))])
    _write(path, [["arm", "env_steps", *map(str, range(1, most + 1))], *rows])


def _text(x: float) -> str:
    return "" if np.isnan(x) else f"{x:.7g}"


def _write(path: Path, rows: Iterable[Sequence[str]]) -> None:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    write(path, text.getvalue())
