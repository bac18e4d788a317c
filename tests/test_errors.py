import pytest

from hitmdp_jax.errors import UsageError, exit_with, missing_extra, out_of_domain, unknown_name


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


def test_a_value_outside_its_domain_is_named_with_what_is_valid():
    assert str(out_of_domain("gamma", 2, "from 0 to 1")) == "gamma = 2 must be from 0 to 1."


def test_a_missing_extra_says_how_to_install_it():
    assert "pip install -e '.[warp]'" in str(missing_extra("warp", "physics=warp"))


def test_a_mistake_in_a_value_is_a_value_error():
    assert isinstance(out_of_domain("gamma", 2, "from 0 to 1"), ValueError)
