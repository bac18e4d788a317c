"""The folder in which mistakes are made, and what every one of them must leave and say."""

import os
import shutil
import sys

import pytest
import yaml

import hitmdp_jax.__main__
from hitmdp_jax.cli import arms
from hitmdp_jax.figures import theorems
from hitmdp_jax.runs import loop
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress
from hitmdp_jax.runs.config import RunConfig
from tests.cli.conftest import WITH_A_HOST
from tests.probes import untrained

OWN = """
from brax.envs.base import Env
from hitmdp_jax.agents import PPO, Agent

value = 3
def function(): ...
class Plain:
    pass
class Task(Env):
    def __init__(self, size=1): ...
    reset = step = observation_size = action_size = backend = None
class AbstractTask(Env):
    pass
class Abstract(Agent):
    pass
class Algo(PPO):
    pass
"""


@pytest.fixture(scope="session")
def workspace(tmp_path_factory):
    """A folder with a good run in it, and with everything that a run's folder can be instead."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "empty").mkdir()
    (folder / "notes.txt").write_text("mine\n")
    (folder / "own.py").write_text(OWN)
    (folder / "torn.py").write_text("class Task(")
    settings = {
        "algo": {"name": "ppo"},
        "env": {"name": "toy/turkey"},
        "seeds": 2,
        "total_steps": 10_000,
    }

    def run(name, text=None, **changes):
        (folder / name).mkdir(parents=True)
        text = text or yaml.safe_dump({"schema": 3} | settings | changes)
        (folder / name / "config.yaml").write_bytes(text.encode("latin-1"))

    def with_checkpoint(name, **changes):
        run(name, **changes)
        shutil.copytree(folder / "run" / "checkpoints", folder / name / "checkpoints")
        return folder / name / "checkpoints"

    run("run")
    config = RunConfig.load(folder / "run")
    checkpoints = Checkpoints(folder / "run")
    checkpoints.save(Progress(2, 0, untrained(config.make_agent(), 2)))
    checkpoints.close()
    for path in with_checkpoint("torn").rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[:10])
    shutil.rmtree(with_checkpoint("garbage") / "2")
    (folder / "garbage" / "checkpoints" / "3").mkdir()
    (folder / "garbage" / "checkpoints" / "3" / "junk").write_text("junk")
    shutil.rmtree(with_checkpoint("stray") / "2")
    (folder / "stray" / "checkpoints" / "notes").mkdir()
    with_checkpoint("misfit", algo={"name": "ppo", "hidden_sizes": [32]})
    with_checkpoint("other_algo", algo={"name": "mopg"})
    with_checkpoint("other_seeds", seeds=3)
    with_checkpoint("other_env", env={"name": "hopper", "version": "v5"})
    with_checkpoint("from_python", env=None)
    with_checkpoint("compared/toy-turkey/ppo-0-5")
    run("unsaved")
    run("broken", "algo: [")
    run("binary", "\xff\xfe\x00")
    run("blank", "\n")
    run("listed", "- 1\n")
    run("python_tag", "algo: !!python/object/apply:os.system ['touch hacked']\n")
    (folder / "directory" / "config.yaml").mkdir(parents=True)
    run("newer", schema=99)
    run("schema_word", schema="two")
    run("unknown_algo", algo={"name": "trpo"})
    run("unknown_env", env={"name": "halfchetah"})
    run("unknown_setting", colour="red")
    run("number_key", **{"algo": {"name": "ppo"}}, text="3: 4\nalgo: {name: ppo}\n")
    run("no_algo", algo=None)
    run("wrong_type", seeds="two")
    run("wrong_env", env="halfcheetah")
    run("wrong_name", env={"name": [1]})
    run("wrong_keyword", env={"name": "toy/turkey", "colour": "red"})
    run("own_gone", env={"name": "gone.py:Task"})
    write_experiments(folder / "experiments")
    return folder


def write_experiments(folder):
    """Write experiments of which each has one fault, that its name tells."""
    folder.mkdir()
    good = {"title": "?", "control": "a", "settings": [], "arms": {"a": []}}
    faults = {
        "arms": {"arms": ["a"]},
        "setting": {"settings": [1]},
        "title": {"title": 1},
        "field": {"seting": []},
        "paper": {"paper": {"a": 1.0}},
        "number": {"arms": {1: []}, "control": 1},
        "control": {"control": "b"},
        "climbs": {"arms": {"a": [], "../../x": []}},
        "parent": {"arms": {"a": [], "..": []}},
        "absolute": {"arms": {"a": [], "/tmp/x": []}},
        "nameless": {"arms": {"a": [], "": []}},
        "lines": {"arms": {"a": [], "b\nc": []}},
        "typo": {"arms": {"a": ["algo.gama=0.9"]}},
    }
    for name, fault in faults.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(good | fault))
    (folder / "short.yaml").write_text("title: none")
    (folder / "torn.yaml").write_text("title: [")
    (folder / "deep.yaml").write_text("[" * 3000)
    (folder / "binary.yaml").write_bytes(b"\xff\xfe\x00")


@pytest.fixture
def unchanged(workspace, monkeypatch):
    """Go to the workspace; nothing may be trained there, and every file must stay as it is."""

    def trained(*args, **kwargs):
        raise AssertionError("it was taken for good")

    monkeypatch.chdir(workspace)
    monkeypatch.setattr(loop, "prepare", trained)
    monkeypatch.setattr(arms, "train", trained)
    monkeypatch.setattr(theorems, "sample_models", trained)
    for module in WITH_A_HOST:
        monkeypatch.setattr(module, "set_up_host", lambda *args: None)
    before = contents(workspace)
    yield
    assert contents(workspace) == before


def contents(folder):
    """Return when every file was written, and its size; but for what Python and a lock leave."""
    found = {}
    for path, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != "__pycache__"]
        found[path] = sorted(folders)
        for name in set(files) - {".lock"}:
            written = os.stat(os.path.join(path, name))
            found[path, name] = written.st_mtime_ns, written.st_size
    return found


@pytest.fixture
def explained(unchanged, monkeypatch, capsys):
    """Run a command line; it must end with one sentence on stderr, nothing on stdout, code 2."""

    def run(command, arguments, part):
        words = [word.strip("'") for word in arguments.split(" ") if word]
        monkeypatch.setattr(sys, "argv", ["hitmdp", command, *words])
        with pytest.raises(SystemExit) as stopped:
            hitmdp_jax.__main__.main()
        out, err = capsys.readouterr()
        *warnings, last = err.splitlines()
        assert last.startswith("error: "), err
        assert part in last
        assert all(line.startswith("warning: ") for line in warnings)
        assert stopped.value.code == 2
        assert out == ""

    return run
