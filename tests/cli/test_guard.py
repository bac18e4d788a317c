import errno
import io
import os
import resource
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.__main__ import COMMANDS, main
from hitmdp_jax.cli.guard import Output, guarded
from hitmdp_jax.cli.run_settings import folder_setting
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.runs.host import set_up_host
from tests.cli.conftest import QUICK, exit_code_of, rows_of


def full():
    return open("/dev/full", "w")


def unread():
    """Return a pipe that nobody reads any more."""
    reads, writes = os.pipe()
    os.close(reads)
    return os.fdopen(writes, "w")


@pytest.mark.parametrize(("stream", "told"), [(full, True), (unread, False)])
@pytest.mark.parametrize("shows", [True, False])
def test_output_that_fails_ends_nothing(monkeypatch, capsys, stream, told, shows):
    done = []

    def command():
        for _ in range(2):
            print("some text", flush=True)
        done.append(True)

    with stream() as broken:
        monkeypatch.setattr(sys, "stdout", broken)
        code = exit_code_of(lambda: guarded(command, shows))
    assert done == [True]
    assert code == (1 if shows else 0)  # what a command is for is lost, or not
    warning = "warning: nothing more can be printed: No space left on device\n"
    assert capsys.readouterr().err == (warning if told else "")


def test_letters_that_a_terminal_does_not_know_are_question_marks(monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    guarded(lambda: print("2 × CPU, \udcff"))
    assert written.getvalue() == b"2 ? CPU, ?\n"


def test_no_file_takes_the_number_of_a_closed_output(monkeypatch, tmp_path):
    """What a library writes to number 1 would otherwise land in the first file that is opened."""
    before, numbers = os.dup(1), []

    def command():
        print("nobody hears it")
        with (tmp_path / "file").open("w") as file:
            numbers.append(file.fileno())

    monkeypatch.setattr(sys, "stdout", None)
    os.close(1)
    try:
        guarded(command)
    finally:
        os.dup2(before, 1)
        os.close(before)
    assert numbers[0] > 2


@pytest.mark.parametrize("name", COMMANDS)
def test_a_working_directory_that_is_gone_is_explained(monkeypatch, tmp_path, capsys, name):
    monkeypatch.setattr(sys, "argv", ["hitmdp", name, "run"])
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert exit_code_of(main) == 2
    assert "The working directory has been deleted" in capsys.readouterr().err


@pytest.mark.parametrize(("most", "raised"), [(20, None), (4096, (64, 4096)), (-1, (64, -1))])
def test_too_few_open_files_are_raised_or_explained(monkeypatch, capsys, most, raised):
    asked = []
    monkeypatch.setattr(resource, "getrlimit", lambda which: (20, most))
    monkeypatch.setattr(resource, "setrlimit", lambda which, limits: asked.append(limits))
    assert exit_code_of(lambda: guarded(lambda: 0)) == (0 if raised else 2)
    assert asked == ([raised] if raised else [])
    assert ("ulimit -n = 20 must be at least 64" in capsys.readouterr().err) == (not raised)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EMFILE, errno.EROFS])
def test_what_the_machine_lacks_is_said_in_a_sentence(capsys, number):
    def command():
        raise OSError(number, os.strerror(number))

    assert exit_code_of(lambda: guarded(command)) == 2
    assert (
        capsys.readouterr().err == f"error: This machine cannot continue: {os.strerror(number)}.\n"
    )


@pytest.mark.parametrize("array", [np.empty, lambda size: jax.jit(lambda: jnp.ones(size))()])
def test_what_memory_does_not_hold_is_said_in_a_sentence(capsys, array):
    assert exit_code_of(lambda: guarded(lambda: array(2**56) is None)) == 2
    assert capsys.readouterr().err.startswith("error: This machine does not have enough memory")


def test_other_errors_keep_their_traceback():
    with pytest.raises(ConnectionError):
        guarded(lambda: (_ for _ in ()).throw(ConnectionError(errno.ECONNREFUSED, "refused")))


def test_a_user_without_a_home_trains_without_a_cache(monkeypatch):
    monkeypatch.setattr("pathlib.Path.home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setattr("hitmdp_jax.runs.host.jax.config.update", lambda name, value: None)
    set_up_host("native", 16)


@pytest.mark.parametrize(
    "path",
    [
        *("a#b", "a(b", "a{b}", "a b", "a=b", "a,b", "äö", "日本"),
        *("a'b", 'a"b', "a\\", "[a]", "1e3", "a:b"),
    ],
)
@pytest.mark.parametrize("name", ["run_dir", "resume"])
def test_a_path_is_taken_letter_for_letter(path, name):
    for text in (path, f"'{path}'") if path.isalpha() else (path,):
        values = Settings([f"{name}={text}"]).values()
        assert str(folder_setting(values, name)) == path


@pytest.mark.whole
def test_a_run_in_a_folder_of_odd_letters_whose_output_is_lost(start, command, tmp_path):
    """Training goes on where nothing can be printed; its folder's name is no URL and no pattern."""
    run_dir = tmp_path / "#(ä{ %41?=,'*"
    with full() as lost:
        process = start("train", *QUICK, "total_steps=2048", f"run_dir={run_dir}", stdout=lost)
        _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert errors == "warning: nothing more can be printed: No space left on device\n"
    more = command("train", f"resume={run_dir}", "total_steps=4096", "report=false")
    assert more.returncode == 0, more.stderr
    assert len(rows_of(run_dir)) == 2
    assert command("evaluate", run_dir, "--episodes=1").returncode == 0


def test_a_stream_keeps_what_else_it_is():
    stream = io.StringIO()
    assert Output(stream).getvalue() == ""
    assert not Output(stream).isatty()
