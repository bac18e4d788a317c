"""What a run reported while it trained, as arrays: its metrics.csv read back."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hitmdp_jax.errors import UsageError
from hitmdp_jax.reading import read_numbers
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import METRICS
from hitmdp_jax.training.sweep import label

Metrics = Mapping[str, np.ndarray]  # as `read_metrics` gives them


def read_metrics(run_dir: Path, trainings: int | None = None) -> dict[str, np.ndarray]:
    """Return a run's metrics as arrays [S, iterations] by column name; missing values are NaN.

    Rows belong together by their iteration, seed and setting, wherever they stand. A report that
    lacks a training's row is left out: a run that was killed, or still writes, leaves such a last
    one. A run without a whole report has no columns.

    Args:
      run_dir: the run's folder.
      trainings: how many the run has, where the arrays' places are to be theirs.

    Raises:
      UsageError: the file cannot be read, a row has not one number per column, or a training lost
        all its rows.
    """
    needed = ("iteration", "env_steps", "seed")
    rows = read_numbers(run_dir / METRICS, needed, unfinished=True)
    reports: dict[float, dict[tuple[float, float], dict[str, float]]] = {}
    for row in rows:
        training = row.get("setting", 0.0), row["seed"]
        reports.setdefault(row["iteration"], {})[training] = row
    counts = Counter(frozenset(report) for report in reports.values())
    if not counts:
        return {}
    every = max(counts, key=lambda trainings: (counts[trainings], len(trainings)))
    if trainings is not None and len(every) != trainings:
        if len(reports) == 1:  # which is being written
            return {}
        raise UsageError(
            f"'{run_dir / METRICS}' has lost rows: it holds {len(every)} of the run's {trainings} "
            "trainings."
        )
    whole = [report for report in reports.values() if report.keys() == every]
    return {
        name: np.array([[of[i][name] for of in whole] for i in sorted(every)]) for name in rows[0]
    }


def by_setting(
    config: RunConfig, columns: Mapping[str, np.ndarray]
) -> dict[str, dict[str, np.ndarray]]:
    """Return a run's metrics by setting: only seeds of one setting can be compared.

    Args:
      config: the run's settings.
      columns: arrays [R, ...] by name, of all trainings.

    Returns:
      What each setting is called, "" in a run that sweeps nothing -> its arrays [S, ...].
    """
    labels = [label(swept) for swept in config.settings]  # rounded: two may be the same
    names = [x if labels.count(x) == 1 else f"{x} (setting {i})" for i, x in enumerate(labels)]
    return {
        name: {column: x[i * config.seeds :][: config.seeds] for column, x in columns.items()}
        for i, name in enumerate(names)
    }
