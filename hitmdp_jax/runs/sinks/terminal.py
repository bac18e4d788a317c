"""What a run shows on a terminal while it goes on."""

import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from hitmdp_jax.learning.episodes import RECENT_EPISODES
from hitmdp_jax.learning.options import mean_duration
from hitmdp_jax.palette import option_color
from hitmdp_jax.runs.sinks.base import Sink, Values
from hitmdp_jax.training.sweep import Training
from hitmdp_jax.training.sweep import label as label_of

WINDOW = 20  # reports that the shown means span, but for the return, which says its own
PLAIN_INTERVAL = 10.0  # seconds between lines where there is no terminal
COLUMNS = 80  # of a line where there is no terminal
RETURN = f"return of the last {RECENT_EPISODES} episodes"
EVALUATION = "return of the last evaluation"
BEST = "best of"  # so many settings: this one
# What such a line says, as far as it fits: what is shown, and how it is said there.
IN_A_LINE = {
    "diverged seeds": "diverged seeds: {}",
    "unstable physics": "unstable in {}",
    RETURN: "return {}",
    BEST: "best of {}",
    EVALUATION: "evaluation {}",
    "steps/s": "{} per s",
    "option duration": "options last {}",
}
PARTS = (("KL", "_kl"), ("clipped", "_clip_fraction"), ("entropy", "_entropy"))


class TerminalSink(Sink):
    """Shows progress, speed and what is being learned; one line per record if nobody watches.

    Args:
      total_steps: environment steps of one seed.
      trainings: what each row of the metrics belongs to. Of a sweep the setting whose return is
        highest is shown: the seeds of one setting alone are repetitions of one another.
      done_steps: of these, how many an earlier process did.
      quiet: show nothing.
    """

    name = "the terminal"

    def __init__(
        self,
        total_steps: int,
        trainings: Sequence[Training],
        done_steps: int = 0,
        quiet: bool = False,
    ):
        self._trainings = trainings
        self._settings = np.array([training.setting for training in trainings])
        self._console = Console(
            highlight=False, soft_wrap=True, quiet=quiet, markup=False, emoji=False
        )
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TextColumn("{task.percentage:.0f}%, elapsed"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self._console,
            expand=True,
        )
        self._task = self._progress.add_task("env steps", total=total_steps, completed=done_steps)
        self._recent: deque[Values] = deque(maxlen=WINDOW)
        self._evaluated: np.ndarray | None = None  # the newest returns [S] of an evaluation
        self._live = Live(console=self._console, refresh_per_second=4, auto_refresh=False)
        self._last_line = 0.0
        self._total_steps = total_steps

    def message(self, text: str) -> None:
        """Print a line."""
        self._console.print(text, soft_wrap=True)

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Say that the program is being compiled, with a clock."""
        start = time.monotonic()
        if not self._console.is_terminal:
            self.message("compiling ...")
            yield
        else:
            self._live.stop()
            clock = TextColumn("compiling"), TimeElapsedColumn()
            with Progress(*clock, console=self._console, transient=True) as shown:
                shown.add_task("")
                yield
        self.message(f"compiled in {time.monotonic() - start:.0f} s")

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Show the metrics of the report that reached `env_steps`."""
        self._recent.append(metrics)
        evaluated = metrics.get("evaluation_return")
        if evaluated is not None and not np.isnan(evaluated).all():
            self._evaluated = evaluated
        if self._console.is_terminal:
            self._live.start()
            self._progress.update(self._task, completed=env_steps)
            self._live.update(Group(self._progress, self._table()), refresh=True)
        elif time.monotonic() - self._last_line > PLAIN_INTERVAL or env_steps == self._total_steps:
            self._last_line = time.monotonic()
            self.message(self._line(env_steps))

    def close(self) -> None:
        """Leave the last picture standing."""
        self._live.stop()

    def _table(self) -> Table:
        table = Table.grid(padding=(0, 2))
        for name, value in self._facts():
            table.add_row(name, value)
        return table

    def _line(self, env_steps: int) -> str:
        facts = dict(self._facts())
        line = f"{env_steps:,} steps ({env_steps / self._total_steps:.0%})"
        for name, said in IN_A_LINE.items():
            longer = f"{line}, {said.format(facts[name])}" if name in facts else line
            line = longer if len(longer) <= COLUMNS else line
        return line

    def _facts(self) -> list[tuple[str, str | Text]]:
        """Return the numbers to show: means over the last reports and the seeds of one setting."""
        newest, best = self._recent[-1], self._best()
        speed = self._mean("steps_per_second").sum()  # of all trainings together
        facts: list[tuple[str, str | Text]] = []
        facts += [] if np.isnan(speed) else [("steps/s", f"{speed:,.0f}")]
        if swept := self._trainings[int(best.argmax())].swept:
            facts.append((BEST, f"{len(set(self._settings))}: {label_of(swept)}"))
        returns = newest["recent_return"][best]
        known = returns[~np.isnan(returns)]
        if known.size:
            spread = f" ± {known.std():,.1f} over {known.size} seeds" if known.size > 1 else ""
            facts.append((RETURN, f"{known.mean():,.1f}{spread}"))
        elif "step_reward" in newest:  # of which something is known before an episode has ended
            rewards = self._mean("step_reward")[best]
            facts.append(("mean reward of a step", f"{rewards.mean():,.3f}"))
        if self._evaluated is not None and not np.isnan(self._evaluated[best]).all():
            facts.append((EVALUATION, f"{np.nanmean(self._evaluated[best]):,.1f}"))
        if "option_steps" in newest:
            counts = [np.nansum(m["option_steps"][best], axis=0) for m in self._recent]
            steps = np.sum(counts, axis=0)
            activations = np.sum([np.nansum(m["option_activations"][best]) for m in self._recent])
            shares = enumerate(steps / max(steps.sum(), 1))
            usage = Text(" ").join(Text(f"{x:.0%}", option_color(k)) for k, x in shares)
            duration = mean_duration(steps.sum(), activations)
            facts += [("option usage", usage), ("option duration", f"{duration:.1f} steps")]
        for label, suffix in PARTS:
            means = {name: self._mean(name)[best] for name in newest if name.endswith(suffix)}
            known = {name: x for name, x in means.items() if not np.isnan(x).all()}
            parts = [f"{n.removesuffix(suffix)} {np.nanmean(x):.3f}" for n, x in known.items()]
            if parts:
                facts.append((label, ", ".join(parts)))
        if "unstable" in newest and np.nansum(self._mean("unstable")) > 0:
            facts.append(("unstable physics", f"{np.nanmean(self._mean('unstable')):.2%} of steps"))
        if newest["diverged"].any():
            facts.append(("diverged seeds", f"{newest['diverged'].sum():.0f}"))
        return facts

    def _best(self) -> np.ndarray:
        """Return which trainings [S] are of the setting whose mean return is highest."""
        returns = self._recent[-1]["recent_return"]
        known = np.isfinite(returns)
        means = {
            setting: returns[known & (self._settings == setting)].mean()
            for setting in np.unique(self._settings[known])
        }
        chosen = max(means, key=means.__getitem__) if means else self._settings[0]
        return self._settings == chosen

    def _mean(self, name: str) -> np.ndarray:
        """Return a metric's mean [S] over the last reports that know it."""
        stacked = np.stack([m[name] for m in self._recent if name in m])
        known = ~np.isnan(stacked)
        total = np.where(known, stacked, 0.0).sum(0)
        return np.where(known.any(0), total / np.maximum(known.sum(0), 1), np.nan)
