"""Tables in a terminal: whatever its width, every word is there, whole."""

import pytest

from hitmdp_jax.experiments.tables import show

ROWS = [
    ["algo.entropy_weight", "env.friction_range", "interquartile mean", "95% interval", "empty"],
    ["0.001", "[0.5,1.5]", "-15.8", "[-17.6, -12.1]", ""],
    ["0.003", "[0.5,1.5]", "1234.5", "[1000.1, 1400.2]", ""],
]


@pytest.mark.parametrize("width", [200, 100, 80, 40, 10])
def test_no_word_is_cut(width, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(width))
    show(ROWS, "a title")
    shown = capsys.readouterr().out
    for row in ROWS:
        for cell in row:
            assert set(cell.split()) <= set(shown.split())
    assert shown.splitlines()[0].strip() == "a title"


def test_a_table_fits_a_terminal_that_is_wide_enough_for_its_words(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "100")
    show(ROWS)
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 100
