"""metrics.csv: one row per report and training."""

import csv
import io
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hitmdp_jax.errors import warn
from hitmdp_jax.reading import read_bytes
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import METRICS, appending, write
from hitmdp_jax.runs.sinks.base import Sink, Values, columns
from hitmdp_jax.training.sweep import Training

INDEX = ("iteration", "env_steps")  # and what tells a training apart
LEADING = ("episode_return", "episode_length", "steps_per_second")


def open_sink(config: RunConfig, run_dir: Path, resume_after: int) -> "CsvSink":
    """Return the sink of a run, which goes on after an iteration."""
    return CsvSink(run_dir, config.trainings, resume_after)


class CsvSink(Sink):
    """Writes metrics.csv. What is not known (NaN) is left empty.

    Args:
      run_dir: the run's folder.
      trainings: what each row of the metrics belongs to; what they sweep has columns, too.
      resume_after: keep the rows up to this iteration, drop the rest; 0 starts afresh. Of a damaged
        file a copy is kept, and how many rows it cost is said.
    """

    name = METRICS

    def __init__(self, run_dir: Path, trainings: Sequence[Training], resume_after: int = 0):
        path = run_dir / METRICS
        self._index = (*INDEX, *trainings[0].columns)
        self._trainings = [tuple(training.columns.values()) for training in trainings]
        self._names = {tuple(map(str, training)) for training in self._trainings}
        kept = self._rows_until(path, resume_after) if resume_after and path.is_file() else []
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

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _rows_until(self, path: Path, iteration: int) -> list[list[str]]:
        """Return header and rows up to an iteration; a killed run leaves more, a torn one last.

        Lines are read one by one: a quote that is damaged must not swallow the lines after it.
        """
        with path.open(encoding="utf-8", errors="replace", newline="") as file:
            lines = [line.replace("\0", "") for line in file]
        header, *rows = [next(csv.reader([line]), []) for line in lines] or [[]]
        known = tuple(header[: len(self._index)]) == self._index
        whole = [known and self._is_whole(row, len(header)) for row in rows]
        damaged = [
            row for row, good, line in zip(rows, whole, lines[1:], strict=True)
            if row and not good and line.endswith("\n")
        ]  # fmt: skip
        if damaged:
            aside = kept_aside(path)
            warn(
                f"{len(damaged)} of the {len(rows)} rows of '{path}' cannot be read and are left "
                f"out; {aside.name} beside it keeps the damaged file."
            )
        kept = [row for row, good in zip(rows, whole, strict=True) if good]
        return [header, *(row for row in kept if int(row[0]) <= iteration)] if known else []

    def _is_whole(self, row: list[str], size: int) -> bool:
        """Return whether a row has so many numbers and is one of the run's trainings'."""
        numbers = len(row) == size and row[0].isdecimal() and all(map(_is_number, row))
        return numbers and tuple(row[len(INDEX) : len(self._index)]) in self._names


def _is_number(text: str) -> bool:
    try:
        float(text or "nan")
    except ValueError:
        return False
    return True


def kept_aside(path: Path) -> Path:
    """Copy a file beside itself, under a name that is free; return the copy.

    Raises:
      OSError: naming the file: it is none, or the copy cannot be written.
    """
    numbers = itertools.chain([""], (f"_{n}" for n in itertools.count(2)))
    names = (path.with_name(f"{path.name}.damaged{number}") for number in numbers)
    aside = next(name for name in names if not name.exists())
    write(aside, read_bytes(path))
    return aside
