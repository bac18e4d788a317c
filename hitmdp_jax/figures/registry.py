"""Every figure by name: a new one is a new file in `catalogue/`.

The file's name is the figure's, its first line says what the figure shows, and its `FIGURE` says
what draws it, from what, and where on a run's page it stands. The command line, the page and the
documentation read the files; no list has to be kept.
"""

import ast
import dataclasses
import enum
import importlib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hitmdp_jax.errors import unknown_name
from hitmdp_jax.figures import catalogue

if TYPE_CHECKING:  # the names are listed without them
    import numpy as np
    from matplotlib.figure import Figure


class Needs(enum.Enum):
    """What a figure is drawn from, and so the argument of its `draw`."""

    METRICS = "a run"  # RunMetrics
    TRAININGS = "all seeds of a run"  # RunMetrics
    SETTINGS = "a sweep"  # name -> Summary, as `interpret.summary.rank` gives them
    RUNS = "several runs"  # Sequence[RunMetrics]
    EPISODES = "recorded episodes"  # OptionAnalysis
    PICTURES = "recorded episodes and pictures of the first"  # OptionAnalysis, step -> picture
    POSES = "recorded episodes and pictures of typical states"  # OptionAnalysis, option -> picture
    MODELS = "random option frameworks"  # OptionModel, as `theorems.sample_models` draws them


class Section(enum.Enum):
    """A section of a run's page, in the order of the page."""

    LEARNING = "What it learned"
    TRAINING = "Options while it learned"
    TIMES = "When each option acts"
    DIFFERENCES = "Do the options differ, and do they matter?"
    EMBEDDINGS = "What an embedding means"
    STATES = "Where each option acts"


class RunMetrics(NamedTuple):
    """A run as its metrics tell of it."""

    title: str
    metrics: "Mapping[str, np.ndarray]"  # [R, iterations], as `read_metrics` gives them
    algorithm: str  # as settings name it
    switch_at: int | None = None  # environment steps after which a transfer's second task began


@dataclasses.dataclass(frozen=True)
class Entry:
    """A figure of the catalogue."""

    title: str
    needs: Needs
    draw: "Callable[..., Figure]"  # it raises UsageError where there is nothing to draw
    section: Section | None = None  # None: not on a run's page
    caption: str = ""  # what a reader of the page needs to know


def summaries() -> dict[str, str]:
    """Return each figure's description, by name, the paper's first; imports no figure's file."""
    folders = map(Path, catalogue.__path__)
    files = {path.stem: path for folder in folders for path in folder.glob("[!_]*.py")}
    numbers = {name: int(name.removeprefix("figure")) for name in files if name[-1].isdigit()}
    names = sorted(files, key=lambda name: (numbers.get(name, math.inf), name))
    return {name: _first_line(files[name]) for name in names}


def find(name: str) -> Entry:
    """Return a figure.

    Raises:
      UsageError: there is none of that name.
    """
    if name not in (names := summaries()):
        raise unknown_name("figure", name, names)
    return _entry(name)


def entries() -> dict[str, Entry]:
    """Return every figure by name."""
    return {name: _entry(name) for name in summaries()}


def _entry(name: str) -> Entry:
    return importlib.import_module(f"hitmdp_jax.figures.catalogue.{name}").FIGURE


def _first_line(path: Path) -> str:
    documentation = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return documentation.partition("\n")[0]
