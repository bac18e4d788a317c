"""The host's side of training: what it reports, when it stops and what it saves."""

import csv
import os
import signal
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.runs import loop, processes
from hitmdp_jax.runs import reporter as reporting
from hitmdp_jax.runs.checkpoint import Progress, saved_iterations
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.reporter import Reporter
from hitmdp_jax.runs.run import Run
from hitmdp_jax.runs.sinks import CsvSink, Sinks
from tests.probes import QUICK

CONFIG = RunConfig.from_mapping(QUICK | {"seed": 3, "total_steps": 4 * 2048})
SCHEDULE = CONFIG.schedule


class Recorder:
    """A sink that keeps what it is given."""

    name = "recorder"

    def __init__(self):
        self.rows = {}

    def write(self, iteration, env_steps, metrics):
        self.rows[iteration] = {"env_steps": env_steps} | metrics

    def flush(self):
        self.rows["flushed"] = len(self.rows)

    def close(self):
        pass


class Every:
    """A hook of one metric, the number of its calls; what it is to do besides is given."""

    names = ("calls",)

    def __init__(self, every, action=lambda progress: None, seeds=1):
        self.every, self.action, self.seeds, self.seen = every, action, seeds, []
        self.closed = []  # whether the run ended early, once it has ended

    def __call__(self, progress, env_steps):
        assert env_steps == 2048 * progress.iteration
        self.action(progress)
        self.seen.append(progress.iteration)
        return {"calls": np.full(self.seeds, float(len(self.seen)))}

    def close(self, stop):
        self.closed.append(stop.requested)


@pytest.fixture
def sink():
    return Recorder()


@pytest.fixture
def reporter(sink):
    """A reporter on its own, and the means to hand it the reports of iterations 1, 2, ..."""

    def make(*hooks):
        made = Reporter(SCHEDULE, 2, Sinks(sink), hooks, lambda progress: progress)
        return made, lambda i, **metrics: made.take(Progress(i, 0, None), report(**metrics))

    return make


def report(recent_return=(1.0, 3.0)):
    return {"recent_return": jnp.array(recent_return)}


def test_a_report_is_written_once_the_next_one_is_under_way(reporter, sink):
    made, take = reporter()
    take(1)
    assert not sink.rows
    take(2)
    assert list(sink.rows) == [1]
    made.flush()
    made.flush()  # nothing is left
    assert [row["env_steps"] for row in sink.rows.values()] == [2048, 4096]


def test_hooks_are_called_when_due_and_stand_in_the_same_row(reporter, sink):
    hook = Every(2 * 2048, seeds=2)
    made, take = reporter(hook)
    for i in range(1, 6):
        take(i)
    made.flush()
    assert hook.seen == [2, 4]
    calls = np.array([sink.rows[i]["calls"] for i in range(1, 6)])
    np.testing.assert_array_equal(calls.T, [[np.nan, 1, np.nan, 2, np.nan]] * 2)


def test_speed_is_that_of_the_last_reports(reporter, sink, monkeypatch):
    """Reports take a second each, but for the first of each program, in which it is compiled."""
    clock = iter([*np.arange(10.0, 15.0), *np.arange(100.0, 200.0)])
    monkeypatch.setattr(reporting.time, "perf_counter", lambda: next(clock))
    made, take = reporter()
    for i in range(1, 6):
        take(i)
    made.flush()
    made.begin()  # a transfer's second program
    for i in range(6, 30):
        take(i)
    made.flush()
    speeds = np.array([row["steps_per_second"][0] for row in sink.rows.values()])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(speeds)), [0, 5])
    np.testing.assert_allclose(speeds[np.isfinite(speeds)], 2048)


def test_the_recent_return_is_the_mean_over_the_seeds_that_have_one(reporter):
    made, take = reporter()
    for values, mean in (((1.0, 3.0), 2.0), ((np.nan, 3.0), 3.0), ((np.nan, np.nan), np.nan)):
        take(1, recent_return=values)
        made.flush()
        np.testing.assert_equal(made.recent_return, mean)


@pytest.fixture(scope="module")
def prepared():
    """The program of CONFIG and its first state, compiled once."""
    progress = Progress(0, 0, None)
    step = loop.prepare(Run.create(CONFIG), 0, progress)
    assert (progress.iteration, progress.task) == (0, 0)
    return step, progress.state


@pytest.fixture
def trained(prepared, monkeypatch, tmp_path):
    """Run CONFIG in a folder."""
    step, first = prepared

    def prepare(run, task, progress):
        saved = progress.state
        progress.state = first if saved is None else jax.device_put(saved, run.mesh.devices[0, 0])
        return step

    def run(*hooks, **arguments):
        monkeypatch.setattr(loop, "prepare", prepare)
        return loop.run(Run.create(CONFIG), tmp_path, hooks=hooks, **arguments)

    return run


def rows_of(folder):
    with (folder / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_run_ends_with_everything_in_its_folder(trained, tmp_path, capsys):
    hook = Every(2048)
    outcome = trained(hook)
    assert outcome == loop.Outcome(4 * 2048, True, None, {}, None)
    assert hook.closed == [False]
    assert RunConfig.load(tmp_path) == CONFIG
    assert saved_iterations(tmp_path) == [4]
    rows = rows_of(tmp_path)
    assert [(row["iteration"], row["seed"], row["calls"]) for row in rows] == [
        (str(i), "3", str(i)) for i in range(1, 5)
    ]
    shown = capsys.readouterr().out.splitlines()
    assert shown[0] == "ppo on invertedpendulum, physics native on 1 × CPU, 16 envs × 1 seeds"


def test_a_request_stops_the_run_which_saves_and_goes_on_later(trained, tmp_path):
    asks = Every(2 * 2048, lambda progress: os.kill(os.getpid(), signal.SIGTERM))
    stopped = trained(asks)
    assert stopped == loop.Outcome(2 * 2048, False, signal.SIGTERM, {}, None)
    assert asks.closed == [True]
    assert saved_iterations(tmp_path) == [2]
    assert [row["iteration"] for row in rows_of(tmp_path)] == ["1", "2"]
    assert trained(resume=True).finished
    assert saved_iterations(tmp_path) == [2, 4]
    assert [row["iteration"] for row in rows_of(tmp_path)] == ["1", "2", "3", "4"]


def test_an_error_in_a_report_does_not_cost_what_was_learned(trained, tmp_path):
    def fail(progress):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        trained(Every(3 * 2048, fail))
    assert saved_iterations(tmp_path) == [3]


def test_a_sink_that_fails_ends_nothing(trained, tmp_path, monkeypatch, capsys):
    def full(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CsvSink, "write", full)
    assert trained().finished
    assert saved_iterations(tmp_path) == [4]
    assert capsys.readouterr().err.count("metrics.csv takes no more metrics") == 1


def test_a_checkpoint_is_written_after_the_rows_before_it(prepared, reporter, sink):
    """What resumes from a checkpoint must find the rows up to it, and of the sinks' all flushed."""
    step, state = prepared
    made, _ = reporter()
    saved = []

    def save():
        saved.append((progress.iteration, made.recent_return, list(sink.rows)))

    progress, stop = Progress(0, 0, state), types.SimpleNamespace(signum=None)
    due, mesh = lambda: progress.iteration == 2, Run.create(CONFIG).mesh
    agreement = processes.Agreement(stop, due, mesh)  # type: ignore
    loop.iterate(SCHEDULE, progress, step, agreement, made, save)
    assert progress.iteration == 4
    ((iteration, recent_return, rows),) = saved
    assert (iteration, rows) == (2, [1, 2, "flushed"])
    assert recent_return == sink.rows[2]["recent_return"].mean()
