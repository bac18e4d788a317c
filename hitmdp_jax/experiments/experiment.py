"""What an experiment is: arms on tasks, each with several seeds. `catalogue/` holds ours."""

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.reading import read_yaml

CATALOGUE = Path(__file__).parent / "catalogue"
FIRST = ("table1", "table2", "table3", "figure11", "options")  # on the page, in this order


@dataclasses.dataclass(frozen=True)
class Experiment:
    """Arms on tasks. Settings are those of train.py, `name=value` each."""

    title: str  # a question, say
    arms: dict[str, list[str]]  # name -> the settings that are its own
    tasks: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    settings: list[str] = dataclasses.field(default_factory=list)  # of every run
    control: str | None = None  # the arm that the others are measured against
    about: str = ""
    paper: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)  # by arm and task
    elsewhere: str = ""  # what others published
    policies: list[str] = dataclasses.field(default_factory=list)  # arms: keep the best policy
    published: bool = False  # whether docs/results.md tells of it

    def settings_of(self, task: str, arm: str, more: Sequence[str] = ()) -> list[str]:
        """Return the settings of one cell: those of the arm count before those of the task.

        Args:
          task: a name among `tasks`.
          arm: a name among `arms`.
          more: settings that count before all others.
        """
        return last_of_each([*self.settings, *self.tasks[task], *self.arms[arm], *more])


def last_of_each(settings: Iterable[str]) -> list[str]:
    """Return settings without those that a later one of the same name replaces."""
    return list({text.split("=", 1)[0]: text for text in settings}.values())


def names() -> list[str]:
    """Return the experiments that come with the package, in the order of the page."""
    found = {path.stem for path in CATALOGUE.glob("*.yaml")}
    return [*FIRST, *sorted(found - set(FIRST))]


def published() -> dict[str, Experiment]:
    """Return the experiments that docs/results.md tells of, by name."""
    every = {name: read(name) for name in names()}
    return {name: experiment for name, experiment in every.items() if experiment.published}


def read(name: str) -> Experiment:
    """Return an experiment by its name in the catalogue, or by the path of a YAML file.

    Raises:
      UsageError: there is none of that name, or the file holds no experiment.
    """
    path = Path(name) if name.endswith(".yaml") else CATALOGUE / f"{name}.yaml"
    if not path.is_file():
        raise unknown_name("experiment", name, names())
    content = read_yaml(path)
    fields = {field.name: field for field in dataclasses.fields(Experiment)}
    if not isinstance(content, dict) or not {"title", "arms"} <= content.keys():
        raise UsageError(f"'{path}' is not an experiment: one has a title and arms.")
    for field in content:
        if field not in fields:
            raise unknown_name(f"field of '{path}'", str(field), fields)
    experiment = Experiment(**content)
    _check(experiment, path)
    return experiment


def _check(experiment: Experiment, path: Path) -> None:
    """Raise UsageError where an experiment is not what it should be; `path` is its file."""
    wrong = f"'{path}' is not an experiment:"
    lists = [experiment.settings, experiment.policies]
    for cells in (experiment.tasks, experiment.arms):
        lists += cells.values() if isinstance(cells, dict) else [None]
    if not experiment.arms or not all(map(_are_texts, lists)):
        raise UsageError(
            f"{wrong} settings and policies are lists of texts, and tasks and arms have such a "
            "list for each name."
        )
    texts = [experiment.title, experiment.about, experiment.elsewhere, experiment.control or ""]
    if not _are_texts([*texts, *experiment.tasks, *experiment.arms]):
        raise UsageError(f"{wrong} its title, its sentences and all names are texts.")
    paper = experiment.paper
    of_arms = paper.values() if isinstance(paper, dict) else [None]
    if not all(isinstance(x, dict) and all(map(_is_number, x.values())) for x in of_arms):
        raise UsageError(f"{wrong} paper has a number for each task of an arm.")
    for arm in [*([experiment.control] if experiment.control else []), *experiment.policies]:
        if arm not in experiment.arms:
            raise unknown_name(f"arm of '{path}'", str(arm), experiment.arms)
    for folder in (*experiment.tasks, *experiment.arms):
        if not is_folder_name(folder):
            raise UsageError(f"{wrong} {folder!r} cannot be a folder's name: no / and no dots.")


def is_folder_name(name: str) -> bool:
    """Return whether a name is that of a folder inside another one, and of nothing else."""
    return name.isprintable() and name == Path(name).name and name not in ("", "..")


def _is_number(x: Any) -> bool:
    return isinstance(x, int | float)


def _are_texts(x: Any) -> bool:
    return isinstance(x, list) and all(isinstance(text, str) for text in x)
