"""A stranger's run folder: whatever reads it runs nothing of it, unless its reader trusts it.

Whatever is planted leaves a marker where it is run, which must not be there afterwards.
"""

import contextlib
import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import hitmdp_jax
import hitmdp_jax.__main__
from hitmdp_jax import plugins
from hitmdp_jax.agents import PPO
from hitmdp_jax.cli import arms
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import published
from hitmdp_jax.runs import loop
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.policy import load_all
from hitmdp_jax.runs.policy_file import write_policy
from hitmdp_jax.runs.saving import extract
from tests.probes import spec_of_sizes, untrained

PLANTED = """
from pathlib import Path
Path(__file__).with_name("marker").touch()
class Class: ...
"""
# Every way to a run's settings, by what it takes to trust them there.
COMMANDS = {
    "train resume=run": "trust=true",
    "evaluate run": "--trust",
    "evaluate run --checkpoint best": "--trust",
    "evaluate a.policy": "--trust",
    "video run": "--trust",
    "export run": "--trust",
    "report run": "--trust",
    "report run other": "--trust",
    "figure figure6 run": "--trust",
    "figure figure5 run": "--trust",
    "experiment own.yaml": "--trust",
    "train -m seed=0,1 run_dir=swept": None,
    "experiment compare run_dir=compared arms=ppo env=toy/turkey": None,
    "experiment results results=results": "--trust",
    "experiment curves results=results": "--trust",
    "experiment options tasks=turkey arms=ppo results=results": "--trust",
}
PYTHON = {
    "RunConfig.load": lambda trust: RunConfig.load(Path("run"), trust=trust),
    "load": lambda trust: hitmdp_jax.load("run", trust=trust),
    "extract": lambda trust: extract("run", "copy.policy", trust=trust),
    "load a file": lambda trust: hitmdp_jax.load("a.policy", trust=trust),
    "load_all": lambda trust: load_all("run"),
    "published.read": lambda trust: published.read(Path("results/turkey"), trust),
}
NAMES = ["algo", "env", "second_env"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a file that nobody has named; it is the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(plugins, "_trusted", set())
    monkeypatch.delattr(loop, "prepare")  # nothing is to be trained
    monkeypatch.delattr(arms, "train")
    plugins._load.cache_clear()
    (tmp_path / "planted.py").write_text(PLANTED)
    return tmp_path


def plant(folder, group="algo", name="planted.py:Class"):
    """Write a run, and whatever else holds one, whose settings name a file."""
    settings = {"algo": {"name": "ppo"}, "env": {"name": "toy/turkey"}, group: {"name": name}}
    for place in ("run", "other", "swept/seed=0", "compared/toy-turkey/ppo-0-1"):
        (folder / place).mkdir(parents=True)
        (folder / place / "config.yaml").write_text(yaml.safe_dump(settings))
    (folder / "results/turkey").mkdir(parents=True)
    (folder / "results/turkey/runs.yaml").write_text(yaml.safe_dump({"ppo": {"config": settings}}))
    (folder / "results/turkey/seeds.csv").write_text(
        "arm,seed,env_steps,last_100k_steps\nppo,0,1,2\n"
    )
    (folder / "results/turkey/curves.csv").write_text("arm,env_steps,1\nppo,1,2\n")
    write_policy(folder / "a.policy", yaml.safe_dump(settings), 1, {}, spec_of_sizes(2, 1))
    arms = {"arm": [f"{group}.name={name}"]}
    question = {"title": "?", "control": "arm", "settings": ["physics=native"], "arms": arms}
    (folder / "own.yaml").write_text(yaml.safe_dump(question))


def call(line, monkeypatch, *more):
    monkeypatch.setattr(sys, "argv", ["hitmdp", *line.split(), *more])
    with pytest.raises(SystemExit) as stopped:
        hitmdp_jax.__main__.main()
    assert stopped.value.code == 2


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_runs_no_file_that_a_run_names_unless_it_is_told_to(
    line, folder, monkeypatch, capsys
):
    plant(folder)
    call(line, monkeypatch)
    _, err = capsys.readouterr()
    assert f"'{folder / 'planted.py'}' would be executed" in err
    assert not (folder / "marker").exists()
    if trust := COMMANDS[line]:
        call(line, monkeypatch, trust)
        assert (folder / "marker").exists()


@pytest.mark.parametrize("group", ["colour", "algo", "env", "physics", "sweep"])
@pytest.mark.parametrize("escaped", [False, True])
def test_no_word_of_a_run_commands_a_terminal(group, escaped, folder, monkeypatch, capsys):
    trick = "\x1b]0;title\x07" if escaped else "[/red]:warning:\u202e"
    value = {"algo": {"name": trick}, "env": {"name": trick}, "sweep": {trick: [1.0, trick]}}
    settings = {"algo": {"name": "ppo"}, "env": {"name": "toy/turkey"}}
    (folder / "run").mkdir()
    text = yaml.safe_dump(settings | {group: value.get(group, trick)})
    (folder / "run" / "config.yaml").write_text(text)
    for line in ("evaluate run", "train resume=run", "report run", "figure figure6 run"):
        call(line, monkeypatch)
        out, err = capsys.readouterr()
        assert out == ""
        assert err.rstrip("\n").isprintable()


@pytest.mark.parametrize("group", NAMES)
@pytest.mark.parametrize("way", PYTHON)
def test_python_runs_no_file_that_a_run_names_unless_it_is_told_to(way, group, folder):
    plant(folder, group)
    with pytest.raises(UsageError, match="no command line of yours has named it"):
        PYTHON[way](False)
    assert not (folder / "marker").exists()
    if way in ("RunConfig.load", "load", "load a file", "extract", "published.read"):
        with pytest.raises(UsageError, match=r"is no algorithm|makes no environment"):
            PYTHON[way](True)
        assert (folder / "marker").exists()


@pytest.mark.parametrize("name", [
    "{folder}/planted.py:Class", "planted.py:Class", "./run/../planted.py:Class", "link.py:Class",
    ["planted.py:Class"], {"planted.py:": 1}, "~/planted.py:Class",
])  # fmt: skip
def test_a_file_is_refused_however_it_is_spelled(name, folder, monkeypatch):
    monkeypatch.setenv("HOME", str(folder))
    (folder / "link.py").symlink_to("planted.py")
    for path in ("['planted.py", "{'planted.py"):  # what the words of a list may name
        (folder / path).write_text(PLANTED)
    name = name.format(folder=folder) if isinstance(name, str) else name
    plant(folder, name=name)
    with pytest.raises(UsageError):
        RunConfig.load(Path("run"))
    assert not (folder / "marker").exists()


def test_what_a_command_line_named_stays_trusted(folder, monkeypatch):
    plugins.own_files().parent.mkdir(parents=True)
    plugins.own_files().write_bytes(b"\xff a damaged line\n")
    call("train env=planted.py:Class", monkeypatch)
    assert (folder / "marker").exists()
    (folder / "marker").unlink()
    monkeypatch.setattr(plugins, "_trusted", set())  # as a later process finds it
    plugins._load.cache_clear()
    plant(folder, "env")
    with pytest.raises(UsageError, match="makes no environment"):
        RunConfig.load(Path("run"))
    assert (folder / "marker").exists()


def test_what_python_saved_stays_trusted_and_another_file_is_not(folder, monkeypatch):
    algorithm = folder / "own.py"
    algorithm.write_text("from hitmdp_jax.agents import PPO\nclass Mine(PPO): ...\n")
    plugins.trust(f"{algorithm}:Mine")
    agent = plugins.load_class(f"{algorithm}:Mine")()
    hitmdp_jax.save("saved", agent, untrained(agent, 1))
    monkeypatch.setattr(plugins, "_trusted", set())
    assert type(hitmdp_jax.load("saved").agent).__name__ == "Mine"
    plant(folder)
    with pytest.raises(UsageError, match="would be executed"):
        hitmdp_jax.load("run")


@pytest.mark.parametrize("state", ["a file", "read-only", "nobody's"])
def test_without_a_place_to_remember_trust_is_needed_each_time(state, folder, monkeypatch):
    place = folder / "state"
    if state == "a file":
        place.write_text("")
    elif state == "read-only":
        monkeypatch.setenv("XDG_STATE_HOME", "/proc")
    else:
        monkeypatch.setenv("XDG_STATE_HOME", "~nobodys/state")
    plugins.trust("planted.py:Class", remember=True)
    monkeypatch.setattr(plugins, "_trusted", set())
    with pytest.raises(UsageError, match="would be executed"):
        plugins.load_class("planted.py:Class")


class Planted:
    """What runs where it is unpickled."""

    def __init__(self, marker):
        self._marker = marker

    def __reduce__(self):
        return open, (str(self._marker), "w")


def pickled(path, marker):
    path.write_bytes(pickle.dumps(Planted(marker)))


def as_numpy(path, marker):
    with path.open("wb") as file:
        np.save(file, np.array([Planted(marker)], object), allow_pickle=True)


def as_archive(path, marker):
    with path.open("wb") as file:
        np.savez(file, x=np.array([Planted(marker)], object))


@pytest.mark.parametrize("plant_in", [pickled, as_numpy, as_archive])
def test_nothing_in_a_checkpoint_is_run(plant_in, folder):
    hitmdp_jax.save("good", PPO(hidden_sizes=(2,)), untrained(PPO(hidden_sizes=(2,)), 1))
    files = [p.relative_to("good") for p in Path("good").rglob("*") if p.is_file()]
    for path in files:
        shutil.copytree("good", "bad", dirs_exist_ok=True)
        plant_in(Path("bad") / path, folder / "marker")
        with contextlib.suppress(UsageError):
            hitmdp_jax.load("bad")
        assert not (folder / "marker").exists(), path


@pytest.mark.parametrize("text", [
    "algo: !!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path [marker]]",
    "algo: {name: ppo, _target_: pathlib.Path.touch, _args_: [marker]}",
    "algo: {name: '${oc.env:HOME}'}",
    "algo: {name: ppo}\nenv: {name: '{{ self.__init__.__globals__ }}'}",
    "algo: {name: pathlib.Path}",
    "algo: {name: ppo}\nhydra: {run: {dir: marker}}",
    "defaults: [{algo: ppo}]\nalgo: {name: ppo}",
])  # fmt: skip
def test_settings_are_words_and_numbers(text, folder):
    (folder / "run").mkdir()
    (folder / "run" / "config.yaml").write_text(text)
    with pytest.raises(UsageError):
        RunConfig.load(Path("run"))
    assert sorted(p.name for p in folder.iterdir()) == ["planted.py", "run"]
