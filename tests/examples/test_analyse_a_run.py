import runpy
from pathlib import Path

import pytest

import hitmdp_jax
from tests.interpret.known_returns import Payment

FILE = Path(__file__).parents[2] / "examples" / "analyse_a_run.py"


@pytest.mark.slow
def test_it_analyses_what_it_trained(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(hitmdp_jax, "make_env", lambda *args, **keywords: Payment())
    runpy.run_path(str(FILE))["main"](tmp_path, num_steps=2048, episodes=2)
    written = capsys.readouterr().out
    assert "own, shuffled" in written
    assert " moves action[0] by " in written
    assert {path.name for path in tmp_path.iterdir()} == {
        "figure5.png",
        "figure7.png",
        "causal.png",
    }


def test_it_stays_short():
    assert len(FILE.read_text().splitlines()) < 60
