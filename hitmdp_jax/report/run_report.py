"""The page about one run: what it learned, what each of its options does, and whether it matters.

The figures about options are those of the catalogue that name a section of this page.
"""

import contextlib
import dataclasses
import functools
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from markupsafe import Markup

from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures import registry
from hitmdp_jax.figures.registry import Needs, RunMetrics
from hitmdp_jax.figures.style import styles
from hitmdp_jax.interpret import interventions
from hitmdp_jax.interpret.comparison import sweep_table
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import sentences
from hitmdp_jax.interpret.returns import final_returns, headline, median_speed
from hitmdp_jax.interpret.statistics import number_text, rounding
from hitmdp_jax.interpret.summary import rank
from hitmdp_jax.interpret.verdict import episodes_needed, verdict
from hitmdp_jax.report.interactive import chart, explorer, learning_curves
from hitmdp_jax.report.page import (
    Parts,
    clips,
    drawing,
    film,
    heading,
    page,
    preformatted,
    table,
    text,
)
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.metrics import by_setting, read_metrics
from hitmdp_jax.runs.provenance import made_with

SETTINGS = 7  # of a sweep whose curves are drawn, the best
CLIPS = 8  # options, those used most, whose clips are shown


class Shown(Protocol):
    """The policy that a page shows: what its options do, and pictures of it."""

    def analyse(self) -> OptionAnalysis:
        """Return what its options do; raises UsageError where it has none."""
        ...

    def video(self, path: Path) -> None:
        """Write a video of it; raises UsageError if it cannot, as the following do."""
        ...

    def clips(self, options: Sequence[int], paths: Sequence[Path]) -> None:
        """Write a clip of each of these options, which acts alone, to a path each."""
        ...

    def poses(self) -> Mapping[int, np.ndarray]:
        """Return option -> picture [height, width, 3] of its typical state."""
        ...


@dataclasses.dataclass(frozen=True, eq=False)
class RunReport:
    """The page about one run.

    Args:
      run_dir: the run's folder.
      config: its settings.
      command: what trains what they say.
      training: the number of the training whose options are shown, among the run's.
      shown: the policy of that training.
      other: another task than the run's, in which it is shown; None is the run's own.
    """

    run_dir: Path
    config: RunConfig
    command: str
    training: int
    shown: Shown
    other: str | None = None

    def html(self) -> str:
        """Return the page."""
        of_options = {
            section.value: functools.partial(self.options, section)
            for section in registry.Section
            if section != registry.Section.LEARNING
        }
        alone = {"Each option alone": self.alone}
        if "num_options" not in self.config.algo:
            alone, of_options = {}, {}  # of an algorithm without options there is nothing to say
        sections = {
            "In short": self.verdict,
            "Video": self.film,
            **alone,
            "What was run": self.summary,
            "What it learned": self.learning,
            **of_options,
            "Settings": self.settings,
        }
        return page(self.config.title, self.subtitle, sections)

    @property
    def subtitle(self) -> str:
        """Whose options are shown, where there are several."""
        config = self.config
        if self.other is not None:
            return (
                f"Options and video show {config.trainings[self.training].name} in "
                f"{plugins.label(self.other)}, on which it was not trained."
            )
        if config.algo.get("num_options", 1) < 2:
            return ""
        task = ""
        if config.switch_at is not None:
            with contextlib.suppress(UsageError):  # how far it came is not known
                iteration = int(self.metrics["iteration"].max())
                task = f" on {config.task_at(iteration)['name']}"
        return f"Everything about options on this page describes {self.policy_shown}{task}."

    @property
    def policy_shown(self) -> str:
        """Which policy is shown: its training, and how long it had learned."""
        name = self.config.trainings[self.training].name
        with contextlib.suppress(UsageError):  # how far it came is not known
            name += f" after {int(self.metrics['env_steps'].max()):,} environment steps"
        return name

    @functools.cached_property
    def metrics(self) -> dict[str, np.ndarray]:
        """The run's metrics [R, iterations].

        Raises:
          UsageError: there is no whole iteration of them.
        """
        metrics = read_metrics(self.run_dir, len(self.config.trainings))
        if not metrics:
            raise UsageError("The run has no finished iteration.")
        return metrics

    @functools.cached_property
    def best(self) -> tuple[str, dict[str, np.ndarray]]:
        """The name and the metrics of a sweep's best setting; of another run "" and its own."""
        if not self.config.sweep:
            return "", self.metrics
        name = next(iter(rank(self.config, self.metrics)))
        return name, by_setting(self.config, self.metrics)[name]

    @property
    def headline(self) -> tuple[str, str]:
        """What the run returned: what the number is of, and the number."""
        setting, metrics = self.best
        name, score = headline(metrics, self.config.switch_at)
        return name + f", of the best setting, {setting}" * bool(setting), score

    @property
    def reached(self) -> str:
        """The share of episodes that reached the goal, the mean over seeds, if the task has one."""
        metrics = self.best[1]
        if "success" not in metrics:
            return ""
        share = final_returns(metrics, self.config.switch_at, "success").mean()
        return "" if np.isnan(share) else f"{share:.0%}"

    @functools.cached_property
    def analysis(self) -> OptionAnalysis:
        """What the policy's options do; raises UsageError where it has none."""
        return self.shown.analyse()

    @functools.cached_property
    def of_training(self) -> RunMetrics:
        """The metrics of the training whose options are shown."""
        i, config = self.training, self.config
        metrics = {name: x[i : i + 1] for name, x in self.metrics.items()}
        return RunMetrics(config.title, metrics, config.algo["name"], config.switch_at)

    def verdict(self) -> Parts:
        """Say what the run returned, whether its options matter, and what to do next."""
        again = [str(self.run_dir), *([] if self.other is None else ["--env", self.other])]
        name, score = self.headline
        yield text(f"{name[0].upper()}{name[1:]}: {score}.")
        if reached := self.reached:
            yield text(f"Of the episodes in those steps, {reached} reached the goal.")
        try:
            analysis = self.analysis
            analysis.check_several_options()
        except UsageError:  # there is nothing to choose between
            yield text("Next, see what it returns where it always takes the likeliest action:")
            yield preformatted(shlex.join(["hitmdp", "evaluate", *again, "--deterministic"]))
            return
        for sentence in (
            *verdict(analysis.interventions),
            interventions.alike(analysis.divergence),
        ):
            yield text(sentence)
        needed = episodes_needed(analysis.interventions)
        if needed:
            yield text("Next, record as many episodes as should tell:")
            yield preformatted(shlex.join(["hitmdp", "report", *again, "--episodes", str(needed)]))
        else:
            yield text("Next, ask the same of every seed:")
            yield preformatted(shlex.join(["hitmdp", "evaluate", *again, "--choices"]))

    def summary(self) -> Parts:
        """Say what was run, with what, and how it ended."""
        config = self.config
        trainings, steps = len(config.trainings), int(self.metrics["env_steps"].max())
        done = f"{steps:,} of {config.schedule.env_steps:,}"
        done += f", of each of {trainings} trainings" if trainings > 1 else ""
        if config.sweep:
            done += f": {config.seeds} seeds of each of {len(config.settings)} settings"
        name, score = self.headline
        returns = final_returns(self.best[1], config.switch_at)
        each = ", ".join(number_text(x, rounding(returns, fewer=1)) for x in returns)
        minutes = steps / median_speed(self.metrics) / 60
        time = f"about {minutes:.0f} minutes" if minutes >= 1.5 else "about a minute"
        yield table(
            [
                ["", ""],
                ["command", self.command],
                ["environment steps", done],
                [name, score],
                *([["each seed", each]] if len(returns) > 1 else []),
                *([["time", time]] if math.isfinite(minutes) else []),
                ["made with", made_with(self.run_dir)],
            ],
            "Facts about the run",
        )

    def learning(self) -> Parts:
        """Draw the return while it learned, seed by seed."""
        config, metrics = self.config, self.metrics
        algorithm: str = config.algo["name"]
        runs = {algorithm: metrics}
        if config.sweep:
            best = rank(config, metrics)
            yield table(sweep_table(best), "Settings of the sweep")
            settings = by_setting(config, metrics)
            runs = {name: settings[name] for name in list(best)[:SETTINGS]}
        looks = styles(dict.fromkeys(runs, algorithm))
        curves = learning_curves(runs, looks, dict.fromkeys(runs, config.switch_at))
        yield chart(curves, "Return of every seed while it learned")
        yield text("Thin lines are seeds, over the last 20 iterations each; the policy samples.")
        yield from self._figures(registry.Section.LEARNING)[0]

    def options(self, section: registry.Section) -> Parts:
        """Draw the catalogue's figures of a section, then what else is said there.

        Raises:
          UsageError: none of them can be drawn, saying why the first cannot.
        """
        drawn, reasons = self._figures(section)
        if not drawn:
            raise reasons[0]
        yield from drawn
        if section in BESIDE:
            yield from BESIDE[section](self.analysis)

    def _figures(self, section: registry.Section) -> tuple[list[Markup], list[UsageError]]:
        """Return the catalogue's figures of a section, and why others cannot be drawn."""
        drawn: list[Markup] = []
        reasons: list[UsageError] = []
        for entry in registry.entries().values():
            if entry.section != section:
                continue
            try:
                figure = entry.draw(*self._needed(entry.needs))
            except UsageError as reason:
                reasons.append(reason)
                continue
            caption = [text(entry.caption)] if entry.caption else []
            drawn += [heading(entry.title), *caption, drawing(figure, entry.title)]
        return drawn, reasons

    def _needed(self, needs: Needs) -> tuple[Any, ...]:
        """Return the arguments of a figure's `draw`."""
        if needs == Needs.METRICS:
            return (self.of_training,)
        if needs == Needs.TRAININGS:
            return (self.of_training._replace(metrics=self.best[1]),)
        if needs == Needs.SETTINGS:
            if not self.config.sweep:
                raise UsageError("The run sweeps nothing.")
            return (rank(self.config, self.metrics),)
        return self.analysis, *([self.shown.poses()] if needs == Needs.POSES else [])

    def film(self) -> Parts:
        """Show how an episode begins, the active option around it and as a strip below."""
        yield film(self.shown.video, "The beginning of an episode")
        yield text(f"The beginning of the first recorded episode of {self.policy_shown}.")

    def alone(self) -> Parts:
        """Show what each option does by itself, all from the state in which the video begins."""
        analysis = self.analysis
        analysis.check_several_options()
        options = sorted(analysis.by_usage[:CLIPS].tolist())
        returns = analysis.interventions.returns[-analysis.num_options :, 0]
        values = [number_text(x, rounding(returns)) for x in returns.tolist()]
        captions = [f"Option {k} alone, from the same state: return {values[k]}" for k in options]
        yield clips(functools.partial(self.shown.clips, options), captions)
        yield text(
            "The video above and all clips begin in one state. In a clip one option acts at every "
            "step. A clip shows how the episode begins; the return is that of the whole episode. "
            "An episode that ends early stands still."
        )

    def settings(self) -> Parts:
        """Quote every setting."""
        yield preformatted(self.config.to_yaml())


def usage(analysis: OptionAnalysis) -> Parts:
    """Tell how often and for how long each option acts."""
    rows = [["option", "share of steps", "mean duration (steps)"]]
    for k in analysis.by_usage:
        lasted = analysis.durations[np.isfinite(analysis.durations[:, k]), k]
        mean = float(lasted.mean()) if lasted.size else np.nan
        rows.append([f"option {k}", f"{analysis.usage[k]:.0%}", number_text(mean)])
    yield table(rows, "How often and how long each option acts")


def returns(analysis: OptionAnalysis) -> Parts:
    """Tell the returns under each way of choosing options."""
    yield table(interventions.table(analysis.interventions), "Returns by how options are chosen")


def dimensions(analysis: OptionAnalysis) -> Parts:
    """Let a reader shift the dimensions of embeddings, and say what the strongest do."""
    yield heading("What a dimension does to the actions")
    yield explorer(analysis)
    found = analysis.perturbation
    assert found is not None
    yield text(found.summary)
    for k in analysis.by_usage[: 0 if found.negligible else 2]:
        yield text(f"Option {k}: {'; '.join(sentences(found, k, analysis.spec.action.names))}.")


BESIDE: dict[registry.Section, Callable[[OptionAnalysis], Parts]] = {
    registry.Section.TIMES: usage,
    registry.Section.DIFFERENCES: returns,
    registry.Section.EMBEDDINGS: dimensions,
}
