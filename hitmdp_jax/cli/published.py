"""The page and the figures of what is published, wherever a command line names it."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from hitmdp_jax.cli.arms import named
from hitmdp_jax.cli.run_settings import writable
from hitmdp_jax.errors import unknown_name
from hitmdp_jax.experiments import experiment as catalogue
from hitmdp_jax.experiments import published, results_figure
from hitmdp_jax.experiments.experiment import Experiment
from hitmdp_jax.experiments.forest import forest
from hitmdp_jax.experiments.results_page import page, shown
from hitmdp_jax.figures.curves import save
from hitmdp_jax.runs.folder import made, write

TRUST = "--trust"


class Places(NamedTuple):
    """Where published results lie, and the page about them."""

    results: Path
    page: Path
    ours: bool = True  # the page tells of all experiments that docs/results.md does

    @classmethod
    def of(cls, given: Mapping[str, str], run_dir: Path, ours: bool) -> "Places":
        """Return the places that a command line names.

        Args:
          given: its settings.
          run_dir: where an experiment keeps its results that docs/results.md does not tell of.
          ours: whether that page tells of it.

        Raises:
          UsageError: one of them cannot be written, hours before it would be.
        """
        results = given.get("results", "results" if ours else run_dir / "results")
        told = given.get("page", "docs/results.md" if ours else run_dir / "results.md")
        folder = writable("results", Path(results), "table1.png")
        return cls(folder, writable("page", Path(told)), ours)


def read_cells(results: Path, tasks: Iterable[str], trust: bool = False) -> published.Cells:
    """Return the published results of some tasks; args and Raises as `published.read`."""
    return {task: published.read(results / task, trust) for task in tasks}


def _ours(results: Path, trust: bool) -> tuple[dict[str, Experiment], published.Cells]:
    """Return the experiments that docs/results.md tells of, and what is published of them."""
    every = catalogue.published()
    tasks = dict.fromkeys(task for experiment in every.values() for task in experiment.tasks)
    return every, read_cells(results, tasks, trust)


def tell(experiments: Mapping[str, Experiment], places: Places, trust: bool = False) -> None:
    """Draw what each experiment found beside the results, and write the page of them.

    Args:
      experiments: name -> experiment; where `places.ours`, all that docs/results.md tells of.
      places: where they lie.
      trust: as `published.read`.
    """
    if places.ours:
        experiments, cells = _ours(places.results, trust)
    else:
        tasks = [task for experiment in experiments.values() for task in experiment.tasks]
        cells = read_cells(places.results, tasks, trust)
    made(places.page.parent)
    if places.ours and (drawn := forest(experiments, cells)):
        save(drawn, places.results / "forest.png", dpi=100)
    pictures = {}
    for name, experiment in experiments.items():
        path = places.results / f"{name}.png"
        if drawn := results_figure.figure(shown(experiment, cells)):
            save(drawn, path, dpi=100)
            link = Path(os.path.relpath(places.results, places.page.parent)).as_posix()
            pictures[name] = f"{link}/{path.name}"
        else:
            path.unlink(missing_ok=True)
    write(places.page, page(experiments, cells, pictures))


def report(arguments: Sequence[str]) -> int:
    """Write the page of everything that is published; Raises as `Places.of`."""
    places, trust = _places(arguments, {})
    tell({}, places, trust)
    print(f"Written: {places.page}.")
    return 0


def draw(arguments: Sequence[str]) -> int:
    """Write a page of all curves that are published; Raises as `Places.of`."""
    # Imported here: Plotly takes as long to import as the rest of the command.
    from hitmdp_jax.experiments.pages import published_page

    places, trust = _places(arguments, {"page": "results.html"})
    write(places.page, published_page(_ours(places.results, trust)[1]))
    print(f"Written: {places.page}.")
    return 0


def _places(arguments: Sequence[str], defaults: dict[str, str]) -> tuple[Places, bool]:
    """Return the places that a command line names, and whether it trusts what lies there.

    Raises:
      UsageError: an argument is neither `results=` nor `page=`, or as `Places.of`.
    """
    given = [text for text in arguments if text != TRUST]
    for name in (text.split("=", 1)[0] for text in given):
        if name not in ("results", "page"):
            raise unknown_name("setting", name, ("results", "page"))
    return Places.of(defaults | named(given), Path(), ours=True), TRUST in arguments
