"""Answer a question by an experiment: `python -m hitmdp_jax study NAME [name=value ...]`.

A study is a file of hitmdp_jax/studies, or a path to one of your own: a question, the settings that
its arms share, the arms, and the one that the others are measured against. Every arm trains all of
its seeds as one program; the table says whether the differences are more than luck. Further
settings are those of train.py and apply to every arm: `study embedding env=swimmer seed=100`. With
`run_dir=` of an earlier study it goes on where that stopped; `append=docs/ablation.md` adds the
question, the table and the command to a notebook. `--trust` runs the files of tasks and algorithms
that the study names and that no command line of yours has named before.
"""

import dataclasses
import time
from pathlib import Path

import hitmdp_jax
from hitmdp_jax.cli.arms import configs_of, last_of_each, train_arms, without_folder
from hitmdp_jax.cli.guard import dispatched
from hitmdp_jax.cli.settings import Settings, folder_setting, writable
from hitmdp_jax.errors import UsageError, unknown_name, warn
from hitmdp_jax.experiments import ablation, tables
from hitmdp_jax.experiments.comparison import length_warning
from hitmdp_jax.figures.curves import read_metrics
from hitmdp_jax.reading import read_yaml
from hitmdp_jax.runs.config import trust_named
from hitmdp_jax.runs.folder import alone, made, write

STUDIES = Path(hitmdp_jax.__file__).parent / "studies"


@dataclasses.dataclass(frozen=True)
class Study:
    """A question and the experiment that answers it."""

    question: str
    control: str  # the arm that the others are measured against
    settings: list[str]  # of every arm
    arms: dict[str, list[str]]  # name -> what is its own


def main() -> None:
    """Run the command line."""
    dispatched(_usage, _run)


def _usage() -> str:
    studies = [f"  {name}: {read(name).question}" for name in names()]
    return "\n".join([str(__doc__), "Studies:", *studies])


def _run(name: str, rest: list[str]) -> int:
    study = read(name)
    trust, rest = "--trust" in rest, [text for text in rest if text != "--trust"]
    notebooks = [text.split("=", 1)[1] for text in rest if text.startswith("append=")]
    notebooks = [writable("append", Path(name)) for name in notebooks]
    rest = [text for text in rest if not text.startswith("append=")]
    own = without_folder(rest)
    arms = {arm: last_of_each([*study.settings, *x, *own]) for arm, x in study.arms.items()}
    values = Settings(rest).values()
    trust_named(values, remember=True)
    configs = configs_of(arms, trust)
    if any(config.sweep for config in configs.values()):
        raise UsageError("study takes no sweep=: its arms name what is compared.")
    folder = folder_setting(values) or Path(
        f"runs/study/{Path(name).stem}/{time.strftime('%Y-%m-%d_%H-%M-%S')}"
    )
    writable("run_dir", folder, "study.md")
    if code := train_arms(arms, folder, trust):
        return code
    runs = {arm: read_metrics(folder / arm) for arm in arms}
    switches = {arm: config.switch_at for arm, config in configs.items()}
    results = ablation.measure(runs, switches, study.control)
    if warning := length_warning({arm.name: arm.env_steps for arm in results}):
        warn(warning)
    rows = ablation.table(results)
    tables.save(rows, folder, "study")
    tables.show(rows)
    command = " ".join(["python -m hitmdp_jax study", name, *own])
    for notebook in notebooks:
        with alone(made(notebook.parent)):
            before = notebook.read_bytes() if notebook.exists() else b""
            told = f"\n## {study.question}\n\n`{command}`\n\n{tables.markdown(rows)}"
            write(notebook, before + told.encode())
    print(f"Saved in {folder}.")
    return 0


def names() -> list[str]:
    """Return the studies that come with the package."""
    return sorted(path.stem for path in STUDIES.glob("*.yaml"))


def read(name: str) -> Study:
    """Return a study by name or path.

    Raises:
      UsageError: there is none of that name, or the file is not a study.
    """
    path = Path(name) if name.endswith(".yaml") else STUDIES / f"{name}.yaml"
    if not path.is_file():
        raise unknown_name("study", name, names())
    content = read_yaml(path)
    fields = [field.name for field in dataclasses.fields(Study)]
    if not isinstance(content, dict) or set(content) != set(fields):
        raise UsageError(f"'{path}' is not a study: one has {', '.join(fields)}.")
    study = Study(**content)
    arms = study.arms if isinstance(study.arms, dict) else {}
    texts = _are_texts([study.question, study.control, *arms])
    if not arms or not texts or not all(map(_are_texts, [study.settings, *arms.values()])):
        raise UsageError(
            f"'{path}' is not a study: settings and each of arms are lists of settings, and names "
            "and the question are texts."
        )
    if study.control not in study.arms:
        raise unknown_name(f"arm of '{path}'", study.control, study.arms)
    return study


def _are_texts(x: object) -> bool:
    return isinstance(x, list) and all(isinstance(text, str) for text in x)
