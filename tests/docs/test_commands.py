"""What a reader can copy out of the manual is understood: nothing is trained here."""

import re
import shlex

import pytest

from hitmdp_jax.agents import AGENTS
from hitmdp_jax.agents.base import hyperparameters_of
from hitmdp_jax.cli import cells, flags
from hitmdp_jax.cli.arms import named
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs import check_env, list_envs
from hitmdp_jax.envs.keywords import parameters_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import experiment as catalogue
from tests.docs.pages import ROOT, commands, pages, spans
from tests.docs.test_extending import FILES

PAGES = pages()
COMMANDS = sorted({command for page in PAGES.values() for command in commands(page)})
COMMANDS = [command for command in COMMANDS if "--help" not in command]
TRAININGS = [
    shlex.split(command, comments=True)[2:]
    for command in COMMANDS
    if command.startswith("python train.py")
]
OTHER = [
    re.sub(r"^python -m hitmdp_jax|^hitmdp|#.*", "", command).split()
    for command in COMMANDS
    if not command.startswith("python train.py")
]
OF_RUNS = [words for words in OTHER if len(words) > 1 and words[0] in flags.COMMANDS]
EXPERIMENTS = [words[1:] for words in OTHER if len(words) > 1 and words[0] == "experiment"]
NAMES = {f"algo.{x.name}" for agent in AGENTS.values() for x in hyperparameters_of(agent)}
# What has the form of a setting and is one of Python's, of another command or of another program.
OTHERS = {"checkpoint", "task", "tasks", "arms", "results", "page", "embeddings"}
OTHERS |= {"launcher", "xla_gpu_deterministic_ops"}


@pytest.fixture(autouse=True)
def here(tmp_path_factory, monkeypatch):
    """Stand where the files are that the manual's commands name."""
    monkeypatch.chdir(ROOT)


@pytest.fixture(scope="module")
def own_files(tmp_path_factory):
    """The manual's own files, which its commands name as if they lay here."""
    folder = tmp_path_factory.mktemp("own")
    for name, code in FILES.items():
        (folder / name.rpartition("/")[2]).write_text(code)
    return folder


@pytest.mark.parametrize("arguments", TRAININGS, ids=" ".join)
def test_a_training_of_the_manual_can_be_run(arguments, own_files, monkeypatch):
    if any("puck.py" in text for text in arguments):
        monkeypatch.chdir(own_files)
    several = "-m" in arguments
    given = [text for text in arguments if text != "-m"]
    try:
        settings = Settings(given, several)
        for job in settings.jobs():
            settings.config(job)
    except UsageError as error:
        if "is not installed" not in str(error):  # a launcher, which is an extra
            raise


@pytest.mark.parametrize("words", OF_RUNS, ids=" ".join)
def test_a_command_of_the_manual_about_runs_is_understood(words, monkeypatch):
    monkeypatch.setattr(flags, "require_run", lambda run_dir: None)
    name, *rest = words
    rest = ["RUN_DIR" if word == "latest" else word for word in rest]  # there is no run here
    arguments = flags.parsed(name, rest)
    assert all(run_dir.name for run_dir in arguments.run_dirs)


@pytest.mark.parametrize("words", EXPERIMENTS, ids=" ".join)
def test_an_experiment_of_the_manual_is_understood(words):
    name, *arguments = words
    if name in ("NAME", "path/to/own.yaml", *cells.TELLERS):
        return
    given = named(arguments)
    settings = [text for text in arguments if text.split("=")[0] not in cells.OWN]
    chosen = cells._chosen(catalogue.read(name), given, settings)
    assert set(given.get("tasks", "").split(",")) - {""} <= set(chosen.tasks)
    assert set(given.get("arms", "").split(",")) - {""} <= set(chosen.arms)
    task, arm = next(iter(chosen.tasks)), next(iter(chosen.arms))
    Settings(chosen.settings_of(task, arm, settings)).config()


def test_the_manual_has_commands_of_every_kind():
    assert len(EXPERIMENTS) > 10
    assert len(TRAININGS) > 30
    assert {name for name, *_ in OF_RUNS} == set(flags.COMMANDS)


def test_every_setting_that_the_manual_names_exists():
    known = set(Settings([]).names([])) | set(Settings([]).groups) | NAMES | OTHERS
    tasks = (*list_envs(), "brax/ant", "gymnax/FourRooms-misc")  # of other libraries, examples
    keywords = {name for task in tasks for name in parameters_of(check_env(task))}
    known |= keywords | {f"env.{name}" for name in keywords}
    known |= {"env.keyword", "env.friction"}  # which stand for any, and for one of a reader's own
    for page, text in PAGES.items():
        for span in spans(text):
            named = [] if "(" in span else re.findall(r"(?<![\w.-])([a-z_]+(?:\.[a-z_]+)*)=", span)
            named += re.findall(r"^((?:algo|env)\.[a-z_]+)$", span)
            assert {x for x in named if not x.startswith("hydra")} <= known, (page, span)
