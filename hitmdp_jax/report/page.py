"""One page about a run, or about several: everything it needs is in it."""

import base64
import dataclasses
import functools
import html
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import ablation
from hitmdp_jax.experiments.comparison import (
    final_returns,
    headline,
    length_warning,
    median_speed,
    one_window,
)
from hitmdp_jax.experiments.statistics import (
    bootstrap_interval,
    interquartile_mean,
    number,
    rounding,
)
from hitmdp_jax.experiments.sweeps import by_setting, rank
from hitmdp_jax.experiments.sweeps import table as sweep_table
from hitmdp_jax.experiments.tables import Rows
from hitmdp_jax.figures.curves import read_metrics
from hitmdp_jax.figures.drawing import limit_of
from hitmdp_jax.figures.style import Style, shades, styles
from hitmdp_jax.interpret import interventions
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import EMBEDDING_SCALE, sentences, strongest
from hitmdp_jax.interpret.visited_states import by_option, cosine_similarities
from hitmdp_jax.report import plots
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.provenance import made_with
from hitmdp_jax.training.sweep import label

SETTINGS = 7  # of a sweep whose curves are drawn, the best
CHART = {"responsive": True, "displayModeBar": False}

Parts = Iterator[Markup]
templates = jinja2.Environment(
    loader=jinja2.PackageLoader("hitmdp_jax.report"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of the page: a question and what answers it."""

    title: str
    parts: list[Markup]

    @property
    def anchor(self) -> str:
        """What a link to it names."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower()).strip("-")


def page(title: str, subtitle: str, sections: Mapping[str, Callable[[], Parts]]) -> str:
    """Return the page [HTML]; a section that cannot be made is left out, and the page says why.

    Args:
      title: of the page.
      subtitle: what stands below it.
      sections: title -> what makes its parts; it raises UsageError if it cannot.
    """
    made: list[Section] = []
    left_out: dict[str, list[str]] = {}  # reason -> the sections that it keeps out
    for name, make in sections.items():
        try:
            made.append(Section(name, list(make())))
        except UsageError as reason:
            left_out.setdefault(str(reason), []).append(name)
    return templates.get_template("page.html").render(
        title=title,
        subtitle=subtitle,
        sections=made,
        left_out=left_out,
        plotly=Markup(get_plotlyjs()),
    )


def chart(shown: go.Figure) -> Markup:
    """Return a figure as a part of the page; whatever its names hold, they are shown as text."""
    how = {"include_plotlyjs": False, "full_html": False, "config": CHART}
    return Markup(go.Figure(as_text(shown.to_plotly_json())).to_html(**how))


def as_text(part: Any, name: str = "") -> Any:
    """Return a part of a figure with its texts escaped: Plotly reads HTML in all of them.

    Args:
      part: a dictionary, a sequence or a value of Plotly's JSON.
      name: what it is called there. Templates, of hovering or of cells, are our own.
    """
    if isinstance(part, str):
        return part if name.endswith("template") else html.escape(part, quote=False)
    if isinstance(part, dict):
        return {key: as_text(value, key) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [as_text(value, name) for value in part]
    return part


def heading(title: str) -> Markup:
    """Return what stands above a figure."""
    return Markup("<h3>{}</h3>").format(title)


def text(sentence: str) -> Markup:
    """Return a paragraph."""
    return Markup("<p>{}</p>").format(sentence)


def preformatted(block: str) -> Markup:
    """Return a block of text as it stands."""
    return Markup("<pre>{}</pre>").format(block)


def table(rows: Rows) -> Markup:
    """Return a table, its header first."""
    return Markup(templates.get_template("table.html").render(rows=rows))


@dataclasses.dataclass(frozen=True, eq=False)
class RunReport:
    """The page about one run.

    Args:
      run_dir: the run's folder.
      config: its settings.
      command: what trains what they say.
      place: the training whose options are shown, by its place among the run's.
      analysis: makes what that policy's options do; it raises UsageError where there are none.
      video: writes a video of that policy to a path; it raises UsageError if it cannot.
    """

    run_dir: Path
    config: RunConfig
    command: str
    place: int
    analysis: Callable[[], OptionAnalysis]
    video: Callable[[Path], None]

    def html(self) -> str:
        """Return the page."""
        training = self.config.trainings[self.place]
        subtitle = f"What is said of options is of {training.name}."
        sections = {
            "What was run": self.summary,
            "What it learned": self.learning,
            "Options while it learned": self.options_in_training,
            "When each option acts": self.behaviour,
            "Do the options differ, and do they matter?": self.causes,
            "What an embedding means": self.embeddings,
            "Where each option acts": self.states,
            "Video": self.film,
            "Settings": self.settings,
        }
        return page(self.config.title, subtitle, sections)

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
    def known(self) -> OptionAnalysis:
        """What the policy's options do."""
        return self.analysis()

    def summary(self) -> Parts:
        """Say what was run, with what, and how it ended."""
        config, metrics = self.config, self.metrics
        trainings, steps = len(config.trainings), int(metrics["env_steps"].max())
        done = f"{steps:,} of {config.env_steps:,}"
        done += f", of each of {trainings} trainings" if trainings > 1 else ""
        if config.sweep:
            done += f": {config.seeds} seeds of each of {len(config.settings)} settings"
            best = rank(metrics, config)[0]
            metrics = list(by_setting(config, metrics).values())[best.setting]
        name, score = headline(metrics, config.switch_at)
        if config.sweep:
            name += f", of the best setting, {label(best.swept)}"
        returns = final_returns(metrics, config.switch_at)
        each = ", ".join(number(x, rounding(returns, fewer=1)) for x in returns)
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
            ]
        )

    def learning(self) -> Parts:
        """Draw the return while it learned, seed by seed."""
        config, metrics = self.config, self.metrics
        runs = {config.algo["name"]: metrics}
        if config.sweep:
            best = rank(metrics, config)
            yield table(sweep_table(best))
            settings = list(by_setting(config, metrics).items())
            runs = dict(settings[result.setting] for result in best[:SETTINGS])
        switches = dict.fromkeys(runs, config.switch_at)
        algorithm: str = config.algo["name"]
        looks = styles(dict.fromkeys(runs, algorithm))
        how = "episode_return", "episode return", looks, switches
        yield chart(plots.learning_curves(runs, *how))
        yield text("Thin lines are seeds, over the last 20 iterations each; the policy samples.")

    def options_in_training(self) -> Parts:
        """Draw how options shared the steps, and how long they lasted."""
        if "option_steps_0" not in self.metrics:
            raise UsageError("The policy has no options.")
        for shown in plots.training_options(self.metrics, self.place, self.config.switch_at):
            yield chart(shown)

    def behaviour(self) -> Parts:
        """Draw which option acts when in recorded episodes."""
        known, K = self.known, self.known.num_options
        recorded, names = known.trajectories, options(K)
        dt = getattr(known.env, "dt", None)
        yield chart(plots.strips(np.asarray(recorded.option), recorded.alive, K, dt))
        rows = [["option", "share of steps", "mean duration (steps)"]]
        for k in known.by_usage:
            lasted = known.durations[np.isfinite(known.durations[:, k]), k]
            mean = float(lasted.mean()) if lasted.size else np.nan
            rows.append([names[k], f"{known.usage[k]:.0%}", number(mean)])
        yield table(rows)
        if K > 1:
            yield heading("Which option follows")
            yield chart(plots.matrix(known.transitions, names, names, 1.0, axes=("next", "now")))
        if K > 1 and known.choices is not None:
            yield heading("How probable the master policy's choice of each option is")
            yield text(
                "P(o_t | s_t, o_{t-1}), mean over the visited states after each option. What is "
                "counted above was drawn with these probabilities."
            )
            yield chart(plots.matrix(known.choices, names, names, 1.0, axes=("next", "now")))

    def causes(self) -> Parts:
        """Show what happens if something else chooses the options, and how far they are apart."""
        known, names = self.known, options(self.known.num_options)
        if known.num_options == 1:
            raise UsageError("The policy has one option.")
        found = known.interventions
        yield text(
            "The same policy from the same initial states; only who chooses the option differs. "
            "Each mark is an episode, each point the mean with its standard error. All of them are "
            "of the policy that was saved; the return above is of episodes in which it was still "
            "learning, so that the two are near each other but not the same."
        )
        yield chart(plots.returns_by_choice(found, interventions.effects(found), known.num_options))
        yield table(interventions.table(found))
        yield heading("How far the options' actions are apart, in nats: mean over visited states")
        limit = limit_of(known.divergence, interventions.DISTINCT)
        yield chart(plots.matrix(known.divergence, names, names, limit, written=".2g"))
        yield text(interventions.alike(known.divergence))

    def embeddings(self) -> Parts:
        """Show the embeddings, and what each of their dimensions does to the actions."""
        known = self.known
        if known.embeddings is None or known.perturbation is None:
            raise UsageError("This algorithm's options are no embeddings.")
        W, found = known.embeddings, known.perturbation
        names, dimensions = options(len(W)), [str(e) for e in range(W.shape[1])]
        yield heading("Embeddings W")
        how: Any = {"axes": ("dimension", ""), "signed": True, "written": None}
        yield chart(plots.matrix(W, names, dimensions, limit_of(W, EMBEDDING_SCALE), **how))
        if len(W) > 1:
            yield heading("Their cosine similarities")
            yield chart(plots.matrix(cosine_similarities(W), names, names, 1.0, signed=True))
        yield heading("What a dimension does to the actions")
        yield explorer(known)
        yield text(found.summary)
        for k in known.by_usage[: 0 if found.negligible else 2]:
            said = sentences(found, k, known.names.actuators)
            yield text(f"Option {k}: {'; '.join(said)}.")

    def states(self) -> Parts:
        """Draw where in the space of states each option acts, and what the parts say there."""
        known, K = self.known, self.known.num_options
        names = options(K)
        yield text("Visited states as the policy sees them, along their two principal components.")
        yield chart(plots.scatter(known.projection, known.states.option))
        if known.terminations is not None and K > 1:
            yield heading("The probability that each option ends, where each one acts")
            means = by_option(known.terminations, known.states.option)
            yield chart(plots.matrix(means, names, names, 1.0))

    def film(self) -> Parts:
        """Show how an episode begins, the active option around it and as a strip below."""
        yield text("The beginning of the first recorded episode.")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "video.mp4"
            self.video(path)
            encoded = base64.b64encode(path.read_bytes()).decode()
        yield Markup('<video controls src="data:video/mp4;base64,{}"></video>').format(encoded)

    def settings(self) -> Parts:
        """Quote every setting."""
        yield preformatted(self.config.to_yaml())


def options(number_of: int) -> list[str]:
    """Return what the options are called."""
    return [f"option {k}" for k in range(number_of)]


def explorer(known: OptionAnalysis) -> Markup:
    """Return the part in which a reader shifts a dimension and sees the actuators move."""
    found = known.perturbation
    assert found is not None
    colors = shades(len(known.names.actuators))
    digits = 4 - math.floor(math.log10(found.limit))  # that a figure can show
    data: dict[str, Any] = {
        "shifts": found.shifts.round(2).tolist(),
        "moved": found.moved.astype(float).round(digits).tolist(),
        "limit": found.limit,
        "order": strongest(np.abs(found.slopes).max(axis=0)).tolist(),
        "actuators": as_text(known.names.actuators),
        "lines": [Style(color, i % 3).plotly for i, color in enumerate(colors)],
        "first": int(known.by_usage[0]),
    }
    parts = {"data": data, "options": options(known.num_options)}
    return Markup(templates.get_template("explorer.html").render(**parts))


def compare(runs: Mapping[str, tuple[Path, RunConfig]], commands: Mapping[str, str]) -> str:
    """Return the page about several runs.

    Args:
      runs: name -> folder and settings; the first is what the others are measured against.
      commands: name -> what trains what its settings say.
    """
    metrics, switches, algorithms = {}, {}, {}
    for run, (folder, config) in runs.items():
        if not (read := read_metrics(folder, len(config.trainings))):
            raise UsageError(f"The run {run} has no finished iteration.")
        for setting, own in by_setting(config, read).items():
            name = f"{run}, {setting}" if setting else run
            metrics[name], switches[name] = own, config.switch_at
            algorithms[name] = config.algo["name"]
    control = next(iter(metrics))
    arms = ablation.measure(metrics, switches, control)
    scores = {arm.name: arm.final_returns for arm in arms}
    looks = styles(algorithms)

    def returns() -> Parts:
        if warning := length_warning({arm.name: arm.env_steps for arm in arms}):
            yield text(warning)
        middles = [interquartile_mean(x) for x in scores.values()]
        ends = [bootstrap_interval(interquartile_mean, x) for x in scores.values()]
        yield chart(plots.intervals(looks, list(scores.values()), middles, ends))
        yield table(ablation.table(arms))
        window = one_window(arm.window for arm in arms)
        yield text(f"Returns are those of {window}; {control} is the control.")

    def curves() -> Parts:
        how = "episode_return", "episode return", looks, switches
        yield chart(plots.learning_curves(metrics, *how))

    def seeds() -> Parts:
        yield chart(plots.profiles(looks, list(scores.values())))

    def made_by() -> Parts:
        yield preformatted("\n".join(commands.values()))
        made = dict.fromkeys(made_with(folder) for folder, _ in runs.values())
        yield text("Made with " + "; and ".join(made) + ".")

    titles = sorted({config.title for _, config in runs.values()})
    sections = {
        "Returns": returns,
        "Learning": curves,
        "What share of seeds reaches a return": seeds,
        "Commands": made_by,
    }
    return page("Comparison", "; ".join(titles), sections)
