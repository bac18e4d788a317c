"""The pages about several runs [HTML]: their returns, their curves, and what made them."""

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from markupsafe import Markup

from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments.published import Cell
from hitmdp_jax.figures import scores
from hitmdp_jax.figures.style import Style, styles
from hitmdp_jax.interpret.comparison import table
from hitmdp_jax.interpret.returns import length_warning, one_window
from hitmdp_jax.interpret.statistics import bootstrap_interval, interquartile_mean
from hitmdp_jax.interpret.summary import Summary, summarize
from hitmdp_jax.report.interactive import chart, learning_curves
from hitmdp_jax.report.page import Parts, beside, drawing, film, heading, page, preformatted, text
from hitmdp_jax.report.page import table as html_table
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.metrics import Metrics, by_setting, read_metrics
from hitmdp_jax.runs.provenance import made_with

FILMED = 4  # runs
_Any = TypeVar("_Any")


def comparison_page(
    runs: Mapping[str, tuple[Path, RunConfig]],
    commands: Mapping[str, str],
    films: Mapping[str, Callable[[Path], None]],
) -> str:
    """Return the page about several runs.

    Args:
      runs: name -> folder and settings; the first is what the others are measured against.
      commands: name -> what trains what its settings say.
      films: name -> what writes a video of its policy to a path; UsageError where it cannot.
    """
    metrics: dict[str, Metrics] = {}
    settings: dict[str, Summary] = {}
    for run, (folder, config) in runs.items():
        if not (read := read_metrics(folder, len(config.trainings))):
            raise UsageError(f"The run {run} has no finished iteration.")
        metrics |= _named(run, by_setting(config, read))
        settings |= _named(run, summarize(config, read).by_setting())
    control = next(iter(settings))
    looks = _looks(settings)

    def returns() -> Parts:
        if warning := length_warning({name: run.env_steps for name, run in settings.items()}):
            yield text(warning)
        yield _intervals(looks, settings)
        yield html_table(table(settings, control, each=True), "Returns")
        window = one_window(run.window for run in settings.values())
        yield text(f"Returns are those of {window}; {control} is the control.")

    def curves() -> Parts:
        yield chart(learning_curves(metrics, looks, _switches(settings)), "Learning curves")

    def seeds() -> Parts:
        yield _profiles(looks, settings)

    def made_by() -> Parts:
        yield preformatted("\n".join(commands.values()))
        made = dict.fromkeys(made_with(folder) for folder, _ in runs.values())
        yield text("Made with " + "; and ".join(made) + ".")

    titles = sorted({config.title for _, config in runs.values()})
    sections = {
        "Returns": returns,
        "Videos": functools.partial(_films, films),
        "Learning": curves,
        "What share of seeds reaches a return": seeds,
        "Commands": made_by,
    }
    return page("Comparison", "; ".join(titles), sections)


def published_page(cells: Mapping[str, Mapping[str, Cell]]) -> str:
    """Return the page about everything that is published; args as `results_page.page`."""
    sections = {task: functools.partial(_task, known) for task, known in cells.items() if known}
    return page("Published results", "every seed of every run in results/", sections, light=True)


def _task(cells: Mapping[str, Cell]) -> Parts:
    curves: dict[str, Metrics] = {}
    settings: dict[str, Summary] = {}
    for arm, cell in cells.items():
        drawn = cell.curves | {"seed": cell.summary.columns["seed"][:, None]}
        curves |= _named(arm, by_setting(cell.summary.config, drawn))
        settings |= _named(arm, cell.summary.by_setting())
    looks = _looks(settings)
    yield chart(learning_curves(curves, looks, _switches(settings), window=1), "Learning curves")
    yield _intervals(looks, settings)
    yield text(
        "Above: the last 100k steps of every seed, the interquartile mean, and its 95% interval "
        "where there are five seeds or more."
    )
    yield _profiles(looks, settings)
    yield preformatted("\n".join(cell.summary.about["command"] for cell in cells.values()))


def _named(run: str, settings: Mapping[str, _Any]) -> dict[str, _Any]:
    """Return the values of a run's settings, by the names of the run and of the setting."""
    return {f"{run}, {setting}" if setting else run: x for setting, x in settings.items()}


def _looks(runs: Mapping[str, Summary]) -> dict[str, Style]:
    return styles({name: run.config.algo["name"] for name, run in runs.items()})


def _switches(runs: Mapping[str, Summary]) -> dict[str, int | None]:
    return {name: run.config.switch_at for name, run in runs.items()}


def _films(films: Mapping[str, Callable[[Path], None]]) -> Parts:
    if len(films) > FILMED:
        raise UsageError(f"Episodes are shown of {FILMED} runs at most.")
    yield beside(
        heading(name) + film(write, f"The beginning of an episode of {name}")
        for name, write in films.items()
    )
    yield text("Each is the first episode of the training with the median return.")


def _intervals(looks: Mapping[str, Style], runs: Mapping[str, Summary]) -> Markup:
    returns = [run.returns for run in runs.values()]
    ends = [bootstrap_interval(interquartile_mean, x) for x in returns]
    middles = [run.iqm for run in runs.values()]
    return drawing(scores.intervals(looks, returns, middles, ends), "Returns")


def _profiles(looks: Mapping[str, Style], runs: Mapping[str, Summary]) -> Markup:
    returns = [run.returns for run in runs.values()]
    return drawing(scores.profiles(looks, returns), "Performance profiles")
