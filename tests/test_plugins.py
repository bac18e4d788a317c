import pytest

from hitmdp_jax.errors import UsageError
from hitmdp_jax.plugins import absolute, is_own, label, load_class, trust

SOURCE = """
import abc
from pathlib import Path

class Task:
    pass

class Unfinished(abc.ABC):
    @abc.abstractmethod
    def step(self): ...

number = 1
"""


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "my_task.py"
    file.write_text(SOURCE)
    trust(f"{file}:Task")
    return file


def test_names_of_files_are_told_from_registered_ones():
    assert is_own("tasks/my_task.py:Task")
    assert not is_own("gym/hopper")


def test_a_name_becomes_absolute_and_short(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert absolute("tasks/../my_task.py:Task") == f"{tmp_path / 'my_task.py'}:Task"
    assert label("tasks/my_task.py:Task") == "my_task.Task"
    assert label("hopper") == "hopper"


def test_a_class_is_loaded_once_however_its_file_is_spelled(file, monkeypatch):
    monkeypatch.chdir(file.parent)
    task = load_class(f"{file}:Task")
    assert task.__name__ == "Task"
    assert load_class("my_task.py:Task") is task


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("nowhere.py:Task", "there is no 'nowhere.py' here"),
        # What the file imports is not its own.
        ("my_task.py:Tsk", "Unknown class of .* did you mean 'Task'.* Valid: Task, Unfinished"),
        ("my_task.py:number", "Unknown class of .* 'number'"),
        ("my_task.py:Unfinished", "is abstract: it still needs step"),
    ],
)
def test_what_cannot_be_loaded_is_explained(file, monkeypatch, name, sentence):
    monkeypatch.chdir(file.parent)
    with pytest.raises(UsageError, match=sentence):
        load_class(name)


def test_what_the_file_raises_is_its_authors_to_see(file):
    file.write_text("1 / 0")
    with pytest.raises(ZeroDivisionError):
        load_class(f"{file}:Task")
