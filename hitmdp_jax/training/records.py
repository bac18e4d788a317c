"""What a run leaves behind while it runs: metrics.csv and TensorBoard events."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tensorboardX import SummaryWriter

INDEX = ("iteration", "env_steps", "seed")
LEADING = ("episode_return", "episode_length", "steps_per_second")


class Records:
    """Writes each iteration's metrics: one CSV row a seed, one TensorBoard point a metric.

    Vector metrics [S, K] become K columns `name_0`, `name_1`, ...

    Args:
      run_dir: the run's folder.
      first_seed: number of the first seed.
      resume_after: keep the rows up to this iteration, drop the rest; 0 starts afresh.
    """

    def __init__(self, run_dir: Path, first_seed: int, resume_after: int = 0):
        self._path = run_dir / "metrics.csv"
        self._first_seed = first_seed
        kept = _rows_until(self._path, resume_after) if resume_after else ""
        self._columns = tuple(kept.splitlines()[0].split(",")) if kept else ()
        self._path.write_text(kept)
        self._file = self._path.open("a", newline="")
        self._csv = csv.writer(self._file)
        self._events = SummaryWriter(str(run_dir), purge_step=resume_after or None)

    def write(self, iteration: int, env_steps: int, metrics: dict[str, np.ndarray]) -> None:
        """Record metrics [S] or [S, K] of one iteration, counted from 1; NaN is left empty."""
        columns = dict(_columns(metrics))
        if not self._columns:
            self._columns = (*INDEX, *columns)
            self._csv.writerow(self._columns)
        num_seeds = len(next(iter(columns.values())))
        for i in range(num_seeds):
            known = {name: x[i] for name, x in columns.items() if not np.isnan(x[i])}
            # A transfer's second task may report other terms than the columns' first one.
            values = (f"{known[n]:.6g}" if n in known else "" for n in self._columns[len(INDEX) :])
            self._csv.writerow((iteration, env_steps, self._first_seed + i, *values))
        self._file.flush()
        for name, x in columns.items():
            known = x[~np.isnan(x)]
            if known.size:
                self._events.add_scalar(f"{name}/mean", known.mean(), env_steps)
                if num_seeds > 1:
                    self._events.add_scalar(f"{name}/std", known.std(), env_steps)

    def close(self) -> None:
        """Flush everything."""
        self._file.close()
        self._events.close()


def _columns(metrics: dict[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    leading = {name: metrics[name] for name in LEADING if name in metrics}
    for name, x in (leading | metrics).items():
        if x.ndim == 1:
            yield name, x
        else:
            yield from ((f"{name}_{k}", x[:, k]) for k in range(x.shape[1]))


def _rows_until(path: Path, iteration: int) -> str:
    """Return the CSV text up to an iteration: a killed run may have written past its checkpoint."""
    out = io.StringIO(newline="")
    with path.open(newline="") as file:
        rows = csv.reader(file)
        writer = csv.writer(out)
        writer.writerow(next(rows))
        writer.writerows(row for row in rows if int(row[0]) <= iteration)
    return out.getvalue()
