import io

import pytest
from rich.console import Console

from hitmdp_jax.cli.waiting import working


@pytest.fixture
def shown(monkeypatch):
    def run(terminal):
        console = Console(file=io.StringIO(), force_terminal=terminal, width=80)
        monkeypatch.setattr("hitmdp_jax.cli.waiting.Console", lambda **_: console)
        with working("drawing a picture"):
            pass
        return console.file.getvalue()

    return run


def test_a_terminal_shows_what_is_done(shown):
    text = shown(terminal=True)
    assert "drawing a picture" in text
    assert "0:00:00" in text


def test_a_pipe_shows_nothing(shown):
    assert shown(terminal=False) == ""


def test_an_error_passes(shown):
    with pytest.raises(ValueError, match="as it was"), working("failing"):
        raise ValueError("as it was")
