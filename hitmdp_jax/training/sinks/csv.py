"""metrics.csv: one row a report and training."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hitmdp_jax.training.folder import METRICS, appending, write
from hitmdp_jax.training.sinks.base import Values, columns
from hitmdp_jax.training.sweep import Training

INDEX = ("iteration", "env_steps")  # and what tells a training apart
LEADING = ("episode_return", "episode_length", "steps_per_second")


class CsvSink:
    """Writes metrics.csv. What is not known (NaN) is left empty.

    Args:
      run_dir: the run's folder.
      trainings: what each row of the metrics belongs to; what they sweep has columns, too.
      resume_after: keep the rows up to this iteration, drop the rest; 0 starts afresh.
    """

    name = METRICS

    def __init__(self, run_dir: Path, trainings: Sequence[Training], resume_after: int = 0):
        path = run_dir / METRICS
        self._index = (*INDEX, *trainings[0].columns)
        self._trainings = [tuple(training.columns.values()) for training in trainings]
        kept = (
            _rows_until(path, self._index, resume_after) if resume_after and path.is_file() else []
        )
        self._columns = tuple(kept[0]) if kept else ()
        text = io.StringIO(newline="")
        csv.writer(text).writerows(kept)
        write(path, text.getvalue())
        self._file = appending(path)
        self._csv = csv.writer(self._file)

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Append a row for each training."""
        leading = {name: metrics[name] for name in LEADING if name in metrics}
        found = dict(columns(leading | metrics))
        if not self._columns:
            self._columns = (*self._index, *found)
            self._csv.writerow(self._columns)
        for i, training in enumerate(self._trainings):
            known = {name: x[i] for name, x in found.items() if not np.isnan(x[i])}
            # A transfer's second task may report other terms than the columns' first one.
            values = (
                f"{known[n]:.6g}" if n in known else "" for n in self._columns[len(self._index) :]
            )
            self._csv.writerow((iteration, env_steps, *training, *values))
        self._file.flush()

    def flush(self) -> None:
        """Nothing is left to do: every write is flushed."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _rows_until(path: Path, index: tuple[str, ...], iteration: int) -> list[list[str]]:
    """Return header and rows up to an iteration; a killed run may have left more, and torn ones."""
    with path.open(encoding="utf-8", newline="", errors="replace") as file:
        rows = list(csv.reader(line.replace("\0", "") for line in file))
    if not rows or tuple(rows[0][: len(index)]) != index:
        return []
    header, *rows = rows
    whole = [row for row in rows if len(row) == len(header) and row[0].isdecimal()]
    return [header, *(row for row in whole if int(row[0]) <= iteration)]
