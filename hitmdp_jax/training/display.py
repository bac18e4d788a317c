"""The live display of a run on a terminal."""

import time
from collections import deque
from types import TracebackType

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from hitmdp_jax.learning.options import mean_duration

WINDOW = 20  # iterations that the shown means span
PLAIN_INTERVAL = 10.0  # seconds between lines where there is no terminal


class Display:
    """Shows progress, speed and what is being learned; plain lines where there is no terminal.

    Args:
      title: one line that says what runs.
      total_steps: environment steps of one seed.
      done_steps: of these, how many an earlier run did.
    """

    def __init__(self, title: str, total_steps: int, done_steps: int = 0):
        self._console = Console(highlight=False)
        self._console.print(title)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=self._console,
            expand=True,
        )
        self._task = self._progress.add_task("env steps", total=total_steps, completed=done_steps)
        self._recent: deque[dict[str, np.ndarray]] = deque(maxlen=WINDOW)
        self._live = Live(console=self._console, refresh_per_second=4, auto_refresh=False)
        self._last_line = 0.0
        self._total_steps = total_steps

    def __enter__(self) -> "Display":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self._live.stop()

    def update(self, env_steps: int, metrics: dict[str, np.ndarray]) -> None:
        """Show metrics [S] or [S, K] of the iteration that reached `env_steps`."""
        self._recent.append(metrics)
        if self._console.is_terminal:
            self._progress.update(self._task, completed=env_steps)
            self._live.update(Group(self._progress, self._table()), refresh=True)
        elif time.monotonic() - self._last_line > PLAIN_INTERVAL or env_steps == self._total_steps:
            self._last_line = time.monotonic()
            facts = "  ".join(f"{name} {value}" for name, value in self._facts())
            self._console.print(f"{env_steps:,} of {self._total_steps:,} env steps  {facts}")

    def message(self, text: str) -> None:
        """Print a line."""
        self._console.print(text)

    def _table(self) -> Table:
        table = Table.grid(padding=(0, 2))
        for name, value in self._facts():
            table.add_row(name, value)
        return table

    def _facts(self) -> list[tuple[str, str]]:
        """Return what is shown: means over the last iterations and all seeds."""
        facts = [("steps/s", f"{self._mean('steps_per_second').sum():,.0f}")]
        returns = self._mean("episode_return")
        if not np.isnan(returns).all():
            mean, std = np.nanmean(returns), np.nanstd(returns)
            facts.append(("return", f"{mean:,.1f} ± {std:,.1f} over {len(returns)} seeds"))
        if "option_steps" in self._recent[-1]:
            steps = np.sum([m["option_steps"].sum(0) for m in self._recent], axis=0)
            activations = np.sum([m["option_activations"].sum() for m in self._recent])
            usage = " ".join(f"{share:.0%}" for share in steps / steps.sum())
            facts.append(("option usage", usage))
            facts.append(
                ("option duration", f"{mean_duration(steps.sum(), activations):.1f} steps")
            )
        for label, suffix in (
            ("KL", "_kl"),
            ("clipped", "_clip_fraction"),
            ("entropy", "_entropy"),
        ):
            parts = [
                f"{name.removesuffix(suffix)} {self._mean(name).mean():.3f}"
                for name in self._recent[-1]
                if name.endswith(suffix)
            ]
            facts.append((label, ", ".join(parts)))
        return facts

    def _mean(self, name: str) -> np.ndarray:
        """Return a metric's mean [S] over the last iterations that know it."""
        stacked = np.stack([m[name] for m in self._recent])
        known = ~np.isnan(stacked)
        total = np.where(known, stacked, 0.0).sum(0)
        return np.where(known.any(0), total / np.maximum(known.sum(0), 1), np.nan)
