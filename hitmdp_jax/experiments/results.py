"""Published results: what is kept of finished runs, small enough to lie in the repository.

A cell is what one algorithm's seeds did on one task, a folder `results/<task>/<arm>`:
  config.yaml  the run's settings
  seeds.csv    one row a training: its final returns, evaluation and use of options
  curve.csv    its training return at `POINTS` points
  about.yaml   the command, the day, versions, hours
and, where it has them, `options_used.png` of a sweep and `policy`: that of the seed whose
deterministic episodes are best, from the newest checkpoint, as they were scored.
"""

import csv
import dataclasses
import io
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hitmdp_jax.experiments.ablation import minutes_of, options_at_the_end
from hitmdp_jax.experiments.comparison import final_returns, mean_return
from hitmdp_jax.figures.curves import read_metrics
from hitmdp_jax.reading import read_numbers, read_yaml, unreadable
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import CONFIG, write

POINTS = 100  # of a published curve
EPISODES = 20  # over which the paper's curves are averaged (App. B), and those of an evaluation
SEEDS, CURVE, ABOUT = "seeds.csv", "curve.csv", "about.yaml"
DRAWING, POLICY = "options_used.png", "policy"
BOTH = "; "  # between what is told of two runs that share a cell

Columns = dict[str, np.ndarray]  # by name, [R] each


@dataclasses.dataclass(frozen=True)
class Cell:
    """What was published of one run of R trainings."""

    config: RunConfig
    seeds: Columns  # as `columns_of` and the evaluation gave them
    about: dict[str, Any]

    @property
    def swept(self) -> str:
        """The first of what the run swept, or nothing."""
        return next(iter(self.config.sweep or {}), "")

    @property
    def num_options(self) -> int:
        """K, or 1 of an algorithm without options."""
        return int(self.config.algo.get("num_options", 1))

    def stands_for(self, config: RunConfig) -> list[str]:
        """Return what tells the cell from a run of these settings; more seeds do not."""
        seeds = min(config.seeds, self.config.seeds)
        return dataclasses.replace(config, seeds=seeds).differences(
            dataclasses.replace(self.config, seeds=seeds)
        )


def publish(
    run_dir: Path,
    folder: Path,
    evaluation: Mapping[str, np.ndarray],
    about: Mapping[str, Any],
    known: Cell | None = None,
    more: Callable[[Path], None] = lambda folder: None,
) -> None:
    """Write what is kept of a finished run, in place of what the folder held.

    A kill at any moment leaves the old cell or the new one, which is always whole.

    Args:
      run_dir: the run's folder.
      folder: the cell's.
      evaluation: further columns [R] of the table of seeds.
      about: the command, versions and whatever else should be known of the run.
      known: what the folder holds, if the run's seeds are to follow those.
      more: adds further files to the folder that it is given, which becomes the cell's.
    """
    config = RunConfig.load(run_dir)
    metrics = read_metrics(run_dir, len(config.trainings))
    seeds, points = columns_of(config, metrics) | dict(evaluation), curve(config, metrics)
    told = dict(about) | {"hours": round(minutes_of(metrics) / 60, 2)}
    beside, old = (folder.with_name(f".{folder.name}.{name}") for name in ("new", "old"))
    _settle(folder)
    for leftover in (beside, old):
        shutil.rmtree(leftover, ignore_errors=True)
    if known:
        shutil.copytree(folder, beside)
        seeds = {name: np.concatenate([known.seeds[name], x]) for name, x in seeds.items()}
        points = _side_by_side(_read(folder / CURVE), points)
        told = _both(known.about, told)
        both = known.config.seeds + config.seeds
        config = dataclasses.replace(config, seed=known.config.seed, seeds=both)
    else:
        beside.mkdir(parents=True)
    _write(beside / SEEDS, seeds)
    _write(beside / CURVE, points)
    write(beside / CONFIG, config.to_yaml())
    write(beside / ABOUT, yaml.safe_dump(told, sort_keys=False, allow_unicode=True))
    more(beside)
    if folder.exists():
        os.replace(folder, old)
    os.replace(beside, folder)
    shutil.rmtree(old, ignore_errors=True)


def _settle(folder: Path) -> None:
    """Bring a cell back of which a kill came between the old one's leaving and the new one."""
    old = folder.with_name(f".{folder.name}.old")
    if old.exists() and not folder.exists():
        os.replace(old, folder)


def read(folder: Path) -> Cell | None:
    """Return a published cell, or None where there is none.

    Raises:
      UsageError: it cannot be read.
    """
    _settle(folder)
    if not (folder / ABOUT).is_file():
        return None
    about = read_yaml(folder / ABOUT)
    if not isinstance(about, dict):
        raise unreadable(folder / ABOUT, "it does not tell of a run")
    return Cell(
        RunConfig.load(folder),
        _read(folder / SEEDS, "seed"),
        about,
    )


def read_curve(folder: Path, switch_at: int | None) -> Columns:
    """Return a published cell's curves as `read_metrics` gives those of a run: [R, points] each.

    A return is NaN at a point that holds episodes of both tasks of a transfer, as those of an older
    version may.

    Args:
      folder: the cell's.
      switch_at: environment steps after which a transfer's second task began; None of one task.

    Raises:
      UsageError: they cannot be read.
    """
    columns = _read(folder / CURVE, "env_steps", "episode_return")
    size = int((columns["env_steps"] == columns["env_steps"][0]).sum())
    if not size or len(columns["env_steps"]) % size:
        raise unreadable(folder / CURVE, "its points are not those of so many curves")
    curves = {name: x.reshape(-1, size).T for name, x in columns.items()}
    if switch_at is not None:
        ends = curves["env_steps"]
        begins = np.concatenate([np.zeros_like(ends[:, :1]), ends[:, :-1]], axis=1)
        mixed = (begins < switch_at) & (switch_at < ends)
        curves["episode_return"] = np.where(mixed, np.nan, curves["episode_return"])
    return curves


def columns_of(config: RunConfig, metrics: Mapping[str, np.ndarray]) -> Columns:
    """Return what is told of each training of a run; returns are those of the training policy.

    Args:
      config: the run's settings.
      metrics: as `read_metrics` gives them.
    """
    switch_at = config.switch_at
    used, duration = options_at_the_end(metrics, switch_at)
    columns = _trainings(config)
    columns["last_20_episodes"] = last_episodes(metrics, EPISODES, switch_at or 0)
    columns["last_100k_steps"] = final_returns(metrics, switch_at)
    if switch_at is not None:
        first = metrics["env_steps"][0] <= switch_at
        columns["first_task"] = final_returns({k: x[:, first] for k, x in metrics.items()}, None)
        # The area under the curve after the switch, in units of a return.
        columns["whole_second_task"] = mean_return(metrics, ~first)
    if "success" in metrics:
        columns["success"] = final_returns(metrics, switch_at, of="success")
    if not np.isnan(used).all():
        columns |= {"options_used": used, "main_option_duration": duration}
    return columns


def last_episodes(metrics: Mapping[str, np.ndarray], count: int, since: int = 0) -> np.ndarray:
    """Return each seed's mean return [R] over its last reports that hold `count` episodes.

    It is NaN for a seed that did not end as many.

    Args:
      metrics: as `read_metrics` gives them.
      count: episodes, at least: all those of a report count.
      since: environment steps before which no episode counts.
    """
    episodes = np.nan_to_num(metrics["episodes"]) * (metrics["env_steps"] > since)
    total = np.nan_to_num(metrics["episode_return"]) * episodes
    after = np.cumsum(episodes[:, ::-1], axis=1)[:, ::-1] - episodes  # those of later reports
    counted = np.where(after < count, episodes, 0.0)
    enough = counted.sum(axis=1) >= count
    mean = np.where(after < count, total, 0.0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1.0)
    return np.where(enough, mean, np.nan)


def _trainings(config: RunConfig) -> Columns:
    """Return what tells the trainings of a run apart, [R] each."""
    names = config.trainings[0].columns
    return {name: np.array([t.columns[name] for t in config.trainings]) for name in names}


def curve(config: RunConfig, metrics: Mapping[str, np.ndarray]) -> Columns:
    """Return the mean return of the episodes that ended before each of `POINTS` points.

    A row is a training at a point; NaN where none ended since the point before. No point holds
    episodes of two tasks: where a transfer switches, one ends.

    Args:
      config: the run's settings.
      metrics: as `read_metrics` gives them.
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
    steps = [metrics["env_steps"][:, part[-1]] for part in parts]
    return {
        **{name: np.tile(x, len(parts)) for name, x in _trainings(config).items()},
        "env_steps": np.concatenate(steps),
        "episode_return": np.concatenate(returns),
    }


def _side_by_side(first: Columns, second: Columns) -> Columns:
    """Return the curves of two runs as one of all their trainings would have them."""
    number = len(set(first["env_steps"]))

    def both(name: str) -> np.ndarray:
        parts = [x[name].reshape(number, -1) for x in (first, second)]
        return np.concatenate(parts, axis=1).ravel()

    return {name: both(name) for name in first}


def _both(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is told of two runs: hours add up, what differs is told of both."""
    told = {
        name: x if first[name] == x else f"{first[name]}{BOTH}{x}"
        for name, x in second.items()
        if name != "hours"
    }
    return told | {"hours": round(first["hours"] + second["hours"], 2)}


def _read(path: Path, *needed: str) -> Columns:
    rows = read_numbers(path, needed)
    if not rows:
        raise unreadable(path, "it holds no rows")
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow("" if np.isnan(x) else f"{x:.7g}" for x in row)
    write(path, text.getvalue())
