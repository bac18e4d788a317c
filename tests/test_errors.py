import contextlib
from pathlib import Path

import pytest

import hitmdp_jax
from hitmdp_jax.errors import (
    UsageError,
    exit_with,
    missing_extra,
    nearest,
    out_of_domain,
    printable,
    unknown_name,
    warn,
)


def test_a_command_ends_with_the_sentence_alone(capsys):
    with pytest.raises(SystemExit) as ending:
        exit_with(UsageError("num_envs = 0 must be a positive whole number."))
    assert ending.value.code == 2
    output = capsys.readouterr()
    assert output.err == "error: num_envs = 0 must be a positive whole number.\n"
    assert output.out == ""


@pytest.mark.parametrize(
    ("name", "valid", "sentence"),
    [
        ("hoper", ["walker2d", "hopper"], "; did you mean 'hopper'? Valid: hopper, walker2d."),
        ("HOPPER", ["hopper"], "; did you mean 'hopper'? Valid: hopper."),
        ("mopg", ["MOPG", "PPO"], "; did you mean 'MOPG'? Valid: MOPG, PPO."),
        ("x", ["walker2d", "hopper"], ". Valid: hopper, walker2d."),
        ("x", [], ": there are none."),
    ],
)
def test_an_unknown_name_comes_with_the_nearest_and_all_valid_ones(name, valid, sentence):
    assert str(unknown_name("task", name, valid)) == f"Unknown task '{name}'{sentence}"


SETTINGS = [
    "algo.learning_rate", "algo.similarity", "algo.name", "algo.gamma", "algo.entropy_weight",
    "algo.hidden_sizes", "algo.clip_eps", "env.name", "num_envs", "rollout_length", "total_steps",
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("algo.lr", "algo.learning_rate"),
        ("lr", "algo.learning_rate"),
        ("learning_rate", "algo.learning_rate"),
        ("Algo.LearningRate", "algo.learning_rate"),
        ("algo.ent_coef", "algo.entropy_weight"),
        ("algo.clip_range", "algo.clip_eps"),
        ("discount", "algo.gamma"),
        ("n_steps", "rollout_length"),
        ("n_envs", "num_envs"),
        ("timesteps", "total_steps"),
        ("algo.colour", None),  # to share a group is no likeness
        ("algo.", None),
        ("x", None),
    ],
)
def test_the_nearest_name_is_one_that_could_be_meant(name, expected):
    assert nearest(name, SETTINGS) == expected


def test_of_many_names_the_nearest_are_shown_and_where_all_are_listed():
    names = [f"task_{i}" for i in range(60)]
    error = str(unknown_name("task", "tusk_42", names))
    assert "did you mean 'task_42'? Valid: task_42, " in error
    assert error.endswith(" and 48 more.")
    error = str(unknown_name("task", "tusk_42", names, listed="list_envs()"))
    assert error.endswith("did you mean 'task_42'? list_envs() lists all 60.")


def test_a_value_outside_its_domain_is_named_with_what_is_valid():
    assert str(out_of_domain("gamma", 2, "from 0 to 1")) == "gamma = 2 must be from 0 to 1."


def test_a_missing_extra_says_how_to_install_it():
    assert "pip install 'hitmdp-jax[warp]'" in str(missing_extra("warp", "physics=warp"))


TRICKS = [
    "\x1b[31m",
    "\x1b]0;title\a",
    "a\nb",
    "\r",
    "\x9b1m",
    "\u202eabc",
    "\u2028",
    "\0",
    "\ud800",
]


@pytest.mark.parametrize("trick", TRICKS, ids=ascii)
def test_nothing_that_is_told_commands_a_terminal(trick, capsys):
    for tell in (
        lambda: exit_with(unknown_name("env", trick, ["hopper"])),
        lambda: exit_with(out_of_domain("env", trick, "a word")),
        lambda: warn(f"'{trick}' cannot be used"),
    ):
        with contextlib.suppress(SystemExit):
            tell()
        (line,) = capsys.readouterr().err.splitlines()
        assert line.isprintable()
    assert printable("naïve, 'x' × \\ 2\t") == "naïve, 'x' × \\ 2\\t"


def test_every_warning_is_told_in_one_place():
    """So that none of them prints the words of somebody else as they are."""
    sources = Path(hitmdp_jax.__file__).parent.rglob("*.py")
    assert [p.name for p in sources if "warning: " in p.read_text()] == ["errors.py"]


def test_a_mistake_in_a_value_is_a_value_error():
    assert isinstance(out_of_domain("gamma", 2, "from 0 to 1"), ValueError)
