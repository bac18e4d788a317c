"""Every file that is read, damaged in every way: its content, or a sentence that names it."""

import os

import numpy as np
import pytest
import yaml

from hitmdp_jax.cli import evaluate
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import experiment, published
from hitmdp_jax.reading import read_numbers, read_rows, read_yaml
from hitmdp_jax.runs import provenance
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FILES, FOLDERS, LOCK
from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.runs.policy_file import read_policy

TABLE = "iteration,env_steps,seed,episode_return\n1,2048,0,\n1,2048,1,2.5\n2,4096,0,1\n2,4096,1,3\n"
RUN = {"schema": 3, "algo": {"name": "ppo", "gamma": 0.9}, "env": {"name": "toy/turkey"}}
EXPERIMENT = {
    "title": "?",
    "control": "a",
    "settings": ["env=toy/turkey"],
    "arms": {"a": ["seeds=1"]},
}
TOLD = {"a": {"command": "train", "hours": 1.0, "config": RUN}}
SEEDS = "arm,seed,env_steps,last_100k_steps\na,0,4096,1.5\na,1,4096,2.5\n"
CURVES = "arm,env_steps,1,2\na,2048,,2.5\na,4096,1,3\n"
READERS = {  # file -> its content, and what reads it
    "config.yaml": (yaml.safe_dump(RUN), RunConfig.load),
    "metrics.csv": (TABLE, read_metrics),
    "made_with.txt": ("jax 0.10\njax 0.11\n", provenance.made_with),
    "evaluations.csv": (
        "iteration,seed,return\n1,0,2.5\n",
        lambda folder: evaluate.append(folder, [{"iteration": 2, "seed": 0, "return": 3.5}]),
    ),
    "runs.yaml": (yaml.safe_dump(TOLD), published.read),
    "seeds.csv": (SEEDS, published.read),
    "curves.csv": (CURVES, published.read),
    "a.policy": (None, lambda folder: read_policy(folder / "a.policy")),
    "own.yaml": (
        yaml.safe_dump(EXPERIMENT),
        lambda folder: experiment.read(str(folder / "own.yaml")),
    ),
    "checkpoints": (None, lambda folder: Checkpoints(folder, read_only=True).restore_policy()),
}
UNREAD = (  # by anything of ours: damage costs the file alone (commands/test_written_files.py)
    ".lock", "report.html", "report_*.html", "sweep.csv", "sweep.md", "events.out.tfevents.*",
    ".*.tmp", "export", "figures", "settings", "videos", "wandb",
)  # fmt: skip
PUBLISHED = ("seeds.csv", "curves.csv", "runs.yaml", "mopg.policy")  # of a task
ANY = {
    "empty": b"",
    "binary": bytes(range(256)),
    "not UTF-8": b"one: 1\nna\xefve: 2\n",
    "zeros": b"\0" * 4096,
    "one long line": b"a" * 200_000,
    "brackets": b"[" * 3000,
    "closed brackets": b"[" * 3000 + b"]" * 3000,
    "quotes": b'"' * 999,
    "a date": b"2020-02-30\n",
    "a list": b"- 1\n- 2\n",
    "escapes": b'"\\e[31m": "\\e]0;title\\a"\n',
    "raw escapes": b"\x1b[31mred: 1\n",
    "a tag": b"a: !!python/name:os.system\n",
    "aliases": b"a: &a [1]\nb: &b [*a, *a]\n",
    "digits": b"schema: " + b"9" * 5000,
}


@pytest.fixture
def folder(tmp_path):
    """A folder that holds every file there is to read."""
    for name, (text, _) in READERS.items():
        if text is not None:
            (tmp_path / name).write_text(text)
    return tmp_path


def assert_read_or_explained(name, folder):
    explained = str(folder)
    try:
        READERS[name][1](folder)
    except UsageError as error:
        explained = str(error)
    except OSError as error:  # of which every command makes a sentence
        explained = error.filename
    assert str(folder) in explained
    assert explained.isprintable()


@pytest.mark.parametrize("name", [LOCK, *FOLDERS, *FILES, *PUBLISHED])
def test_damage_to_every_file_has_an_answer(name):
    """It has one reader, or none at all; test_checkpoint.py goes through a checkpoint's files."""
    names = (name, name.removesuffix("*"), name.replace("mopg.policy", "a.policy"))
    assert sum(answer in names for answer in [*READERS, *UNREAD]) == 1


@pytest.mark.parametrize("damage", ANY)
@pytest.mark.parametrize("name", READERS)
def test_a_file_that_holds_something_else_is_explained(name, damage, folder):
    (folder / name).write_bytes(ANY[damage])
    assert_read_or_explained(name, folder)


@pytest.mark.parametrize("name", [name for name, (text, _) in READERS.items() if text])
def test_a_file_that_is_torn_or_in_which_bits_changed_is_explained(name, folder):
    rng = np.random.default_rng(0)
    whole = (folder / name).read_bytes()
    for place in range(len(whole)):
        changed = bytes([whole[place] ^ (1 << int(rng.integers(8)))])
        for content in (whole[:place], whole[:place] + changed + whole[place + 1 :]):
            (folder / name).write_bytes(content)
            assert_read_or_explained(name, folder)


@pytest.mark.parametrize("kind", ["a folder", "a link to itself", "a pipe", "gone"])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_explained(name, kind, folder):
    (folder / name).unlink(missing_ok=True)
    if kind == "a folder":
        (folder / name).mkdir()
    elif kind == "a link to itself":
        (folder / name).symlink_to(name)
    elif kind == "a pipe":  # nobody writes into it: whoever reads it waits for ever
        os.mkfifo(folder / name)
    assert_read_or_explained(name, folder)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: 1\nb: [2\n", "line 3: expected ',' or ']'"),
        ("a: 1\nb: !!set {a}\n", "line 2: the tag 'tag:yaml.org,2002:set' stands for something"),
        ("a: 1\n\nb: &x 2\nc: *x\n", "line 4: an alias stands for something"),
        ("a: 1\nb: " + "[" * 30 + "]" * 30, "line 2: more than 20 lists and mappings"),
        ("a: 1\nb: " + "9" * 5000, "line 2: Exceeds the limit"),
        ('a: 1\nb: "\\e[31m"\n', "line 2: a word holds a control character"),
        ('"\\r": 1\n', "line 1: a word holds a control character"),
        ("a: 1\nb: \x1b[31m\n", "line 2: it holds a control character"),
    ],
)
def test_what_settings_cannot_hold_is_named_with_its_line(text, sentence, tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(UsageError) as error:
        read_yaml(path)
    assert f"'{path}' cannot be read: {sentence}" in str(error.value)


def test_settings_are_words_numbers_lists_and_mappings(tmp_path):
    written = {"a": [1, 2.5, None, True, "word", "2020-02-30", "naïve"], "b": {"c": {}}, "d": "off"}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(written, allow_unicode=True), "utf-8")
    assert read_yaml(tmp_path / "a.yaml") == written
    (tmp_path / "a.yaml").write_text("day: 2020-02-28\n")
    assert read_yaml(tmp_path / "a.yaml") == {"day": "2020-02-28"}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a,b\n1,2\n1,two\n", "line 3: b = two is not a number"),
        ("a,b\n1,2\n1\n", "line 3: it has 1 cells, not 2"),
        ("a,b\n1,2,3\n", "line 2: it has 3 cells, not 2"),
        ('a,b\n1,"2\n3,4\n', "line 2: unexpected end of data"),
        ("b,b\n1,2\n", "line 1: two columns have one name"),
        ("a\n1\n", "line 1: no column is called 'b'"),
        (f"a,b\n1,{'9' * 200_000}\n", "line 2: field larger than field limit"),
    ],
)
def test_what_a_table_cannot_hold_is_named_with_its_line(text, sentence, tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text(text)
    with pytest.raises(UsageError) as error:
        read_numbers(path, needed=("b",))
    assert f"'{path}' cannot be read: {sentence}" in str(error.value)


def test_what_made_a_run_is_printable(folder):
    (folder / "made_with.txt").write_bytes(b"jax \x1b[31m\xff\nnumpy\x07\n")
    assert provenance.made_with(folder).isprintable()


def test_no_other_character_ends_a_line_of_a_table(tmp_path):
    ends = "\x0b\x0c\x1c\x85\u2028\u2029"  # where Python's splitlines would
    (tmp_path / "t.csv").write_text(f"x,{ends}\n1,2\n", encoding="utf-8")
    assert read_rows(tmp_path / "t.csv") == [(2, {"x": "1", ends: "2"})]


def test_a_damaged_file_of_evaluations_is_kept_aside_and_a_new_one_is_begun(folder, capsys):
    damaged = b"iteration,seed,return\n1,0,\xff\n"
    (folder / "evaluations.csv").write_bytes(damaged)
    READERS["evaluations.csv"][1](folder)
    assert (folder / "evaluations.csv").read_text().split() == ["iteration,seed,return", "2,0,3.5"]
    assert (folder / "evaluations.csv.damaged").read_bytes() == damaged
    assert "line 2" in capsys.readouterr().err


def test_a_last_row_without_its_end_is_left_out_where_a_program_may_have_been_killed(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text("a,b\r\n1,\r\n3,4")
    with pytest.raises(UsageError, match="line 3: it ends in the middle"):
        read_numbers(path)
    (row,) = read_numbers(path, unfinished=True)
    assert row["a"] == 1
    assert np.isnan(row["b"])


JUNK = [None, True, 1.5, -1, "word", "2020-01-01", "", "~nouser/x.py:C"]
JUNK += [[1], [[1]], {}, {"a": 1}, {1: 2}]


@pytest.mark.parametrize("group", ["", "algo", "env", "second_env", "sweep"])
def test_a_name_that_is_no_text_is_explained(group, tmp_path):
    good = RunConfig.from_mapping({k: x for k, x in RUN.items() if k != "schema"}).to_dict()
    good |= {"second_env": good["env"], "sweep": {"algo.gamma": [0.9, 0.99]}}
    settings = good | ({group: good[group] | {1: 2}} if group else {1: 2})
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(settings))
    with pytest.raises(UsageError, match="1"):
        RunConfig.load(tmp_path)


@pytest.mark.parametrize("junk", JUNK, ids=repr)
def test_a_setting_of_another_kind_is_explained(junk, tmp_path):
    good = RunConfig.from_mapping({k: x for k, x in RUN.items() if k != "schema"}).to_dict()
    for group, names in {"": [*good, "schema"], "algo": good["algo"], "env": good["env"]}.items():
        for name in names:
            settings = {**good, **({group: good[group] | {name: junk}} if group else {name: junk})}
            (tmp_path / "config.yaml").write_text(yaml.safe_dump(settings))
            assert_read_or_explained("config.yaml", tmp_path)
