import io
import re

import numpy as np
import pytest
from rich.console import Console

from hitmdp_jax.runs.sinks.terminal import TerminalSink
from tests.probes import trainings


def metrics(num_seeds=1, **changes):
    ones = np.ones(num_seeds)
    return {
        "steps_per_second": 500.0 * ones,
        "recent_return": 10.0 + np.arange(num_seeds),
        "option_steps": np.array([[30.0, 10.0]] * num_seeds),
        "option_activations": np.array([[2.0, 2.0]] * num_seeds),
        "option_kl": 0.01 * ones,
        "action_kl": 0.02 * ones,
        "action_entropy": 1.5 * ones,
        "diverged": 0.0 * ones,
        "unstable": 0.0 * ones,
    } | changes


@pytest.fixture
def shown(monkeypatch):
    def run(*reports, terminal=False, total=4096):
        out = io.StringIO()
        console = Console(file=out, width=80, force_terminal=terminal, highlight=False)
        monkeypatch.setattr("hitmdp_jax.runs.sinks.terminal.Console", lambda **_: console)
        sink = TerminalSink(total, trainings(len(reports[0]["diverged"])))
        for i, report in enumerate(reports, start=1):
            sink.write(i, 2048 * i, report)
        sink.close()
        return out.getvalue()

    return run


def test_a_record_is_one_line_however_narrow_the_pipe(shown):
    lines = shown(metrics(), metrics()).splitlines()
    assert len(lines) == 2
    assert lines[-1] == "4,096 steps (100%), return 10.0, 500 per s, options last 10.0 steps"


def test_a_line_ends_where_the_next_thing_would_not_fit(shown):
    long = metrics(
        16,
        recent_return=np.full(16, -164555.0),
        diverged=np.eye(16)[0],
        steps_per_second=np.full(16, 1e4),
    )
    (line,) = shown(long, total=1_015_808).splitlines()
    assert line == ("2,048 steps (0%), diverged seeds: 1, return -164,555.0 ± 0.0 over 16 seeds")


def test_the_newest_evaluation_is_shown_until_there_is_another(shown):
    none = metrics(evaluation_return=np.array([np.nan]))
    lines = shown(none, metrics(evaluation_return=np.array([12.5])), none, total=6144).splitlines()
    assert "evaluation" not in lines[0]
    assert "evaluation 12.5" in lines[-1]


def test_one_seed_has_no_deviation_and_several_do(shown):
    assert "±" not in shown(metrics())
    assert "10.5 ± 0.5 over 2 seeds" in shown(metrics(2))


def test_what_went_wrong_is_shown(shown):
    lost = metrics(2, diverged=np.array([0.0, 1.0]), unstable=np.array([0.25, np.nan]))
    lost["option_steps"] = np.array([[30.0, 10.0], [np.nan, np.nan]])
    text = shown(lost)
    assert "diverged seeds: 1" in text
    assert "unstable in 25.00% of steps" in text
    assert "nan" not in text
    assert "diverged" not in shown(metrics())


def test_before_an_episode_ended_no_return_is_shown(shown):
    assert "return" not in shown(metrics(recent_return=np.array([np.nan])))


def test_a_speed_that_is_not_known_yet_is_not_shown(shown):
    assert "per s" not in shown(metrics(steps_per_second=np.array([np.nan])))


def test_a_terminal_shows_progress(shown):
    text = shown(metrics(), terminal=True)
    assert "2048/4096" in text
    assert "50%, elapsed" in text
    assert "option usage" in text
    assert re.search(r"\x1b\[[\d;]+m75%\x1b\[0m \x1b\[[\d;]+m25%\x1b\[0m", text)
    assert "option 0.010, action 0.020" in text
