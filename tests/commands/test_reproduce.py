"""`python -m hitmdp_jax.reproduce` as a user runs it."""

import sys

import jax
import pytest

from hitmdp_jax import reproduce


@pytest.fixture
def command(monkeypatch):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["reproduce", *map(str, arguments)])
        reproduce.main()

    return run


def test_theory_writes_its_figures(command, tmp_path):
    command("theory", "seed=1", f"run_dir={tmp_path / 'theory'}")
    written = {path.name: path.stat().st_size for path in (tmp_path / "theory").iterdir()}
    assert set(written) == {"contraction.png", "variance.png"}
    assert all(10_000 < size < 150_000 for size in written.values())
    assert not jax.config.read("jax_enable_x64")  # left as it was


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["comparison"], "Unknown target 'comparison'; did you mean 'compare'?"),
        (["compare", "algos=mopg,pppo"], "Unknown algo 'pppo'; did you mean 'ppo'?"),
        (["compare", "halfcheetah"], "'halfcheetah' is not of the form name=value"),
        (["theory", "sed=1"], "Unknown setting 'sed'; did you mean 'seed'?"),
        (["theory", "seed=-1"], "seed = -1 must be a whole number"),
        (["theory", f"run_dir={__file__}"], f"run_dir = {__file__} cannot be made"),
    ],
)
def test_bad_input_is_explained(command, capsys, arguments, sentence):
    with pytest.raises(SystemExit) as stopped:
        command(*arguments)
    assert stopped.value.code == 2
    errors = capsys.readouterr().err
    assert errors.startswith(f"error: {sentence}")
    assert errors.count("\n") == 1
