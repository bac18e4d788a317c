import ast
import errno
import os
from pathlib import Path

import pytest

import hitmdp_jax
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs import folder
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.claim import claim, clear, locked
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.sinks.tensorboard import TensorboardSink
from tests.probes import trainings

CONFIG = RunConfig(algo={"name": "ppo"}, env={"name": "halfcheetah"}, total_steps=4096)
NAMES = {name: value for name, value in vars(folder).items() if name.isupper()}
MEMBERS = [pattern.replace("*", "x") for pattern in (folder.LOCK, *folder.FOLDERS, *folder.FILES)]


def plant(path, elsewhere):
    """Put a link to something precious in place of a file or folder of a run; return its files."""
    is_folder = path.name in folder.FOLDERS
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        path.rename(elsewhere)
    elif is_folder:
        elsewhere.mkdir()
        (elsewhere / "precious").write_text("precious")
    else:
        elsewhere.write_text("precious")
    path.symlink_to(elsewhere)
    return contents(elsewhere)


def contents(path):
    """Return all files of a folder, or the one file, with what they hold."""
    files = path.rglob("*") if path.is_dir() else [path]
    return {file: file.read_bytes() for file in files if file.is_file()}


@pytest.mark.parametrize("name", MEMBERS)
@pytest.mark.parametrize(
    "begin",
    [lambda run_dir: claim(run_dir, CONFIG, overwrite=True), lambda x: locked(x).__enter__()],
)
def test_no_part_of_a_run_may_be_a_link(tmp_path, name, begin):
    run_dir = tmp_path / "run"
    if name != folder.CONFIG:
        claim(run_dir, CONFIG)
    elsewhere = tmp_path / "elsewhere"
    if name == folder.LOCK:
        (run_dir / name).unlink()
    before = plant(run_dir / name, elsewhere)
    with pytest.raises(UsageError, match=f"'{run_dir / name}' .*nothing is written through one"):
        begin(run_dir)
    assert contents(elsewhere) == before


def test_clearing_leaves_what_links_lead_to(tmp_path):
    """A link that appeared after the check is removed itself, not what it stands for."""
    run_dir = claim(tmp_path / "run", CONFIG)
    before = {name: plant(run_dir / name, tmp_path / name) for name in MEMBERS[1:-1]}
    clear(run_dir)
    assert [path.name for path in run_dir.iterdir()] == [folder.LOCK]
    assert {name: contents(tmp_path / name) for name in before} == before


@pytest.mark.parametrize("name", [folder.CHECKPOINTS, "checkpoints/4.orbax-checkpoint-tmp"])
def test_checkpoints_are_written_through_no_link(tmp_path, name):
    elsewhere = tmp_path / "elsewhere"
    before = plant(tmp_path / name, elsewhere)
    with pytest.raises(OSError, match="nothing is written through one"):
        Checkpoints(tmp_path)
    assert contents(elsewhere) == before


def test_no_link_can_be_planted_where_events_will_be(tmp_path, monkeypatch):
    """The same second, machine and step give another name."""
    monkeypatch.setattr("tensorboardX.event_file_writer.time.time", lambda: 1.0)
    for _ in range(2):
        TensorboardSink(tmp_path, trainings(), 5).close()
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("write", [folder.write, lambda path, text: folder.appending(path).close()])
def test_a_file_is_written_through_no_link(tmp_path, write):
    elsewhere = tmp_path / "elsewhere"
    for make in (lambda: elsewhere.write_text("precious"), elsewhere.unlink):
        make()
        (tmp_path / "link").unlink(missing_ok=True)
        (tmp_path / "link").symlink_to(elsewhere)
        with pytest.raises(OSError, match="nothing is written through one") as raised:
            write(tmp_path / "link", "new")
        assert raised.value.filename == str(tmp_path / "link")
    assert not elsewhere.exists()


def test_a_link_that_appears_between_a_look_and_the_opening_is_not_followed(tmp_path, monkeypatch):
    (tmp_path / folder.LOCK).symlink_to(tmp_path / "elsewhere")
    monkeypatch.setattr(Path, "is_symlink", lambda path: False)
    with pytest.raises(UsageError, match="nothing is written through one"):
        locked(tmp_path).__enter__()
    assert not (tmp_path / "elsewhere").exists()


def test_whoever_locks_a_run_removes_what_kills_left_and_nothing_that_is_being_written(tmp_path):
    for name in (".config.yaml.0123abcd.tmp", f"{folder.FIGURES}/.figure6.png.0123abcd.tmp"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with folder.replaced(tmp_path / folder.REPORT) as file:
        with locked(tmp_path):
            assert [path.name for path in tmp_path.glob(".*.tmp")] == [Path(file.name).name]
            assert not list((tmp_path / folder.FIGURES).iterdir())
        file.write(b"whole")
    assert (tmp_path / folder.REPORT).read_bytes() == b"whole"


def test_a_file_that_is_removed_before_it_is_locked_is_made_anew(tmp_path, monkeypatch):
    """By a second writer, which takes it for what a kill left."""
    flock, removed = folder.fcntl.flock, []

    def remove_first(file, how):
        if not removed:
            removed.extend(tmp_path.glob(".file.*.tmp"))
            removed[0].unlink()
        flock(file, how)

    monkeypatch.setattr(folder.fcntl, "flock", remove_first)
    folder.write(tmp_path / "file", "new")
    assert removed
    assert (tmp_path / "file").read_text() == "new"


def test_the_next_writer_removes_what_a_kill_left_of_this_file_and_of_no_other(tmp_path):
    others = (".b.0123abcd.tmp", ".[ab].mine.tmp", "[ab].0123abcd.tmp")
    for name in (".[ab].0123abcd.tmp", *others):
        (tmp_path / name).touch()
    with folder.replaced(tmp_path / "[ab]"):
        folder.write(tmp_path / "[ab]", "meanwhile")  # which leaves what is being written
    assert {path.name for path in tmp_path.iterdir()} == {"[ab]", *others}


def test_a_pipe_in_a_files_place_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / folder.LOCK)
    with pytest.raises(UsageError, match="cannot be written"):
        locked(tmp_path).__enter__()


def test_only_a_file_is_replaced(tmp_path):
    """As root, `--out /dev/null` would otherwise replace the device."""
    for path in (Path(os.devnull), tmp_path):
        with pytest.raises(OSError, match="it is not a file"):
            folder.write(path, "new")


@pytest.mark.parametrize("old", [None, "old"])
@pytest.mark.parametrize("step", ["open", "write", "fsync", "replace"])
def test_a_file_is_the_old_or_the_new_one_wherever_its_writer_ends(
    tmp_path, monkeypatch, old, step
):
    """Where the disk is full at any step, or the process is killed there, which cleans nothing."""
    path = tmp_path / "file"
    if old:
        path.write_text(old)

    where = {"open": (Path, "open"), "fsync": (os, "fsync"), "replace": (os, "replace")}

    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    def write():
        with folder.replaced(path) as file:
            file.write(b"n")
            file.flush()
            if step == "write":
                full()
            file.write(b"ew")

    with monkeypatch.context() as patch:
        if step in where:
            patch.setattr(*where[step], full)
        with pytest.raises(OSError, match="No space left") as raised:
            write()
        assert raised.value.filename == str(path)
    assert [p.name for p in tmp_path.iterdir()] == (["file"] if old else [])
    with monkeypatch.context() as patch:  # killed, or read-only: no cleaning is done either
        patch.setattr(Path, "unlink", full)
        if step in where:
            patch.setattr(*where[step], full)
        with pytest.raises(OSError, match="No space left") as raised:
            write()
        assert raised.value.filename == str(path)
    assert (path.read_text() if path.exists() else None) == old
    folder.write(path, "new")
    assert path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]  # whoever writes next cleans
    (tmp_path / "other").touch()
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode


def test_the_names_of_a_runs_files_are_spelled_in_one_place():
    """So that whatever clears, checks or fills a run's folder speaks of the same files."""
    spelled = {value for value in NAMES.values() if isinstance(value, str)} - {folder.EVENTS}
    package = Path(hitmdp_jax.__file__).parent
    for path in package.rglob("*.py"):
        if path == Path(folder.__file__):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                right = node.right
                assert not (isinstance(right, ast.Constant) and right.value in spelled), (
                    f"{path}:{node.lineno} spells a run's {right.value!r}"
                )


# What is no file of a run, a page, a video, an export or a result, or is not written by path.
OTHERS = {
    "figures/curves.py": "savefig",  # into the file that `replaced` gives
    "report/page.py": "savefig",  # into memory
    "cli/guard.py": "open",  # nothing
    "plugins.py": "open",  # notes whom this user trusts, in a file of this user's
    "cli/video.py": "open",  # what a process says, in a temporary folder
}


def test_files_are_written_in_one_place():
    """What holds of `replaced`, at a kill or on a full disk, so holds of every file."""
    package, found = Path(hitmdp_jax.__file__).parent, {}
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            modes = [x.value for x in node.args if isinstance(x, ast.Constant)]
            writes = any(isinstance(x, str) and set(x) & set("wax") and len(x) < 4 for x in modes)
            if name in ("write_text", "write_bytes", "savefig") or (name == "open" and writes):
                found[str(path.relative_to(package))] = name
    del found["runs/folder.py"]
    assert found == OTHERS
