"""What is published of a run, against plain loops over its reports."""

import csv
import itertools
import os
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hitmdp_jax.experiments import results
from hitmdp_jax.runs.config import RunConfig

TASK = {"name": "dmc/cheetah_run"}


def made_up(random, reports=150, seeds=3, options=2):
    """Return metrics as `read_metrics` gives them, of reports of 2048 steps."""
    shape = (seeds, reports)
    episodes = random.integers(0, 4, shape).astype(float)
    returns = np.where(episodes > 0, random.normal(100, 30, shape), np.nan)
    metrics = {
        "env_steps": np.tile(2048.0 * np.arange(1, reports + 1), (seeds, 1)),
        "episodes": episodes,
        "episode_return": returns,
        "steps_per_second": np.full(shape, 1000.0),
    }
    for k in range(options):
        metrics[f"option_steps_{k}"] = random.integers(1, 2000, shape).astype(float)
        metrics[f"option_activations_{k}"] = random.integers(1, 50, shape).astype(float)
    return metrics


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(0, 300_000))
def test_the_last_episodes_are_those_a_loop_from_the_end_finds(seed, count, since):
    metrics = made_up(np.random.default_rng(seed))
    for i, found in enumerate(results.last_episodes(metrics, count, since)):
        total = episodes = 0.0
        for t in reversed(range(metrics["env_steps"].shape[1])):
            if episodes >= count or metrics["env_steps"][i, t] <= since:
                break
            if metrics["episodes"][i, t]:
                episodes += metrics["episodes"][i, t]
                total += metrics["episodes"][i, t] * metrics["episode_return"][i, t]
        expected = total / episodes if episodes >= count else np.nan
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_curve_holds_every_episode_once():
    metrics = made_up(np.random.default_rng(0))
    config = RunConfig(algo={"name": "mopg"}, env=TASK, seeds=3, seed=7, total_steps=150 * 2048)
    curve = results.curve(config, metrics)
    assert len(curve["seed"]) == 3 * results.POINTS
    own = curve["seed"] == 8
    steps, returns = curve["env_steps"][own], curve["episode_return"][own]
    assert steps[-1] == 150 * 2048
    ends = np.searchsorted(metrics["env_steps"][1], steps)
    for point, (start, end) in enumerate(zip([-1, *ends[:-1]], ends, strict=True)):
        part = slice(start + 1, end + 1)
        episodes, values = metrics["episodes"][1, part], metrics["episode_return"][1, part]
        expected = np.nansum(episodes * values) / episodes.sum() if episodes.sum() else np.nan
        np.testing.assert_allclose(returns[point], expected, rtol=1e-12)


def test_a_transfer_tells_its_tasks_apart():
    metrics = made_up(np.random.default_rng(1), reports=200)
    metrics["episode_return"][:, :100] = 5.0
    metrics["episode_return"][:, 100:] = 7.0
    config = RunConfig(
        algo={"name": "mopg"}, env=TASK, second_env=TASK, seeds=3, total_steps=100 * 2048
    )
    columns = results.columns_of(config, metrics)
    np.testing.assert_allclose(columns["first_task"], 5.0)
    np.testing.assert_allclose(columns["whole_second_task"], 7.0)
    np.testing.assert_allclose(columns["last_100k_steps"], 7.0)
    assert (columns["options_used"] == 2).all()


def test_no_point_of_a_curve_holds_episodes_of_both_tasks():
    metrics = made_up(np.random.default_rng(1), reports=250)  # 125 on each: no whole points
    first = np.arange(250) < 125
    metrics["episode_return"][:] = np.where(first, 279.0, 2.2)
    config = RunConfig(
        algo={"name": "mopg"}, env=TASK, second_env=TASK, seeds=3, total_steps=125 * 2048
    )
    curve = results.curve(config, metrics)
    after = curve["env_steps"] > config.switch_at
    assert len(after) == 3 * results.POINTS
    known = np.isfinite(curve["episode_return"])
    np.testing.assert_allclose(curve["episode_return"][known], np.where(after, 2.2, 279.0)[known])


def test_a_point_of_both_tasks_in_an_older_curve_is_not_shown(tmp_path):
    rows = ["seed,env_steps,episode_return"]
    rows += [f"{seed},{steps},{steps}" for steps in (100, 200, 300, 400) for seed in (0, 1)]
    (tmp_path / "curve.csv").write_text("\n".join([*rows, ""]))
    for switch_at, known in ((None, [1, 1, 1, 1]), (200, [1, 1, 1, 1]), (210, [1, 1, 0, 1])):
        curves = results.read_curve(tmp_path, switch_at)
        expected = np.where(known, [100.0, 200.0, 300.0, 400.0], np.nan)
        np.testing.assert_array_equal(curves["episode_return"], [expected, expected])


def test_success_is_that_of_the_episodes_at_the_end_and_only_where_the_task_knows_it():
    metrics = made_up(np.random.default_rng(3))
    config = RunConfig(algo={"name": "mopg"}, env=TASK, seeds=3, total_steps=150 * 2048)
    assert "success" not in results.columns_of(config, metrics)
    episodes = metrics["episodes"]
    metrics["success"] = np.where(episodes > 0, 0.25, np.nan)
    metrics["success"][:, -1], episodes[:, -1] = 1.0, 4.0
    last = metrics["env_steps"][0] > 150 * 2048 - 100_000
    before = episodes[:, last][:, :-1].sum(axis=1)
    expected = (0.25 * before + 4.0) / (before + 4.0)
    np.testing.assert_allclose(results.columns_of(config, metrics)["success"], expected)


def trained(run_dir, metrics, seed):
    """Write a run's folder, of the seeds from this one on."""
    run_dir.mkdir()
    seeds, reports = metrics["env_steps"].shape
    config = RunConfig(algo={"name": "mopg"}, env={"name": "swimmer"}, seeds=seeds, seed=seed)
    (run_dir / "config.yaml").write_text(config.to_yaml())
    with (run_dir / "metrics.csv").open("w") as file:
        writer = csv.writer(file)
        writer.writerow(["iteration", "seed", *metrics])
        for t in range(reports):
            for i in range(seeds):
                writer.writerow([t + 1, seed + i, *(x[i, t] for x in metrics.values())])
    return config


@pytest.fixture
def cell(tmp_path):
    """A published cell of two seeds, 3 and 4."""
    run_dir, metrics = tmp_path / "run", made_up(np.random.default_rng(2), seeds=2)
    config = trained(run_dir, metrics, 3)
    folder = tmp_path / "results" / "swimmer" / "mopg"
    for _ in range(2):  # a second time replaces the first
        results.publish(run_dir, folder, {"evaluation": np.array([1.5, np.nan])}, {"day": "today"})
    return folder, config, metrics


def test_what_is_published_is_read_back(cell):
    folder, config, metrics = cell
    read = results.read(folder)
    assert read is not None
    assert read.config == config
    assert read.about == {
        "day": "today",
        "hours": pytest.approx(150 * 2048 / 1000 / 3600, abs=0.01),
    }
    np.testing.assert_array_equal(read.seeds["seed"], [3, 4])
    np.testing.assert_array_equal(read.seeds["evaluation"], [1.5, np.nan])
    expected = results.last_episodes(metrics, 20)
    np.testing.assert_allclose(read.seeds["last_20_episodes"], expected, rtol=1e-6)
    assert [path.name for path in folder.parent.iterdir()] == ["mopg"]
    curve, expected = results.read_curve(folder, None), results.curve(config, metrics)
    for name, x in curve.items():
        np.testing.assert_allclose(x.T.ravel(), expected[name], rtol=1e-6)


class KilledError(BaseException):
    """Ends a publication at one of its steps, as a kill does."""


def test_a_kill_at_any_step_of_a_publication_leaves_the_old_cell_or_the_new_one(cell, tmp_path):
    folder, _, _ = cell

    def publish():
        known = results.read(folder)
        seeds = {"evaluation": np.array([2.5, 3.5])}
        assert known
        of_new = {"day": "new"}, None, lambda beside: (beside / "more").write_text("more")
        results.publish(tmp_path / "run", folder, seeds, *of_new)

    seen, step = [], 0
    while seen[-1:] != ["finished"]:
        step += 1
        steps = itertools.count(1)

        def stepping(function, steps=steps, last=step):
            def call(*args, **kwargs):
                if next(steps) == last:
                    raise KilledError
                return function(*args, **kwargs)

            return call

        with pytest.MonkeyPatch.context() as patch:
            for where, name in ((os, "replace"), (os, "fsync"), (shutil, "rmtree")):
                patch.setattr(where, name, stepping(getattr(where, name)))
            try:
                publish()
                seen.append("finished")
            except KilledError:
                there = results.read(folder)
                assert there
                day = there.about["day"]
                assert there.seeds["evaluation"][0] == {"today": 1.5, "new": 2.5}[day]
                assert (folder / "more").exists() == (day == "new")
                seen.append(day)
        if seen[-1] != "today":
            publish_again = {"evaluation": np.array([1.5, np.nan])}, {"day": "today"}
            results.publish(tmp_path / "run", folder, *publish_again)
    assert seen[:-1] == sorted(seen[:-1], reverse=True)
    assert {"today", "new"} <= set(seen)
    assert [path.name for path in folder.parent.iterdir()] == ["mopg"]


def test_seeds_that_follow_make_the_cell_that_all_at_once_would(tmp_path):
    metrics = made_up(np.random.default_rng(4), seeds=5)
    parts = {"all": slice(5), "first": slice(3), "rest": slice(3, 5)}
    for name, part in parts.items():
        trained(tmp_path / name, {k: x[part] for k, x in metrics.items()}, 3 + (part.start or 0))

    def publish(name, folder, known=None):
        evaluation = {"evaluation": np.arange(5.0)[parts[name]]}
        about = {"command": name, "with": "this"}
        results.publish(tmp_path / name, tmp_path / folder, evaluation, about, known)

    publish("all", "whole")
    publish("first", "grown")
    (tmp_path / "grown" / "policy").mkdir()
    publish("rest", "grown", results.read(tmp_path / "grown"))
    for name in (results.CONFIG, results.SEEDS, results.CURVE):
        assert (tmp_path / "grown" / name).read_text() == (tmp_path / "whole" / name).read_text()
    assert (tmp_path / "grown" / "policy").is_dir()
    grown, whole = results.read(tmp_path / "grown"), results.read(tmp_path / "whole")
    assert grown
    assert whole
    assert (grown.about["command"], grown.about["with"]) == ("first; rest", "this")
    assert grown.about["hours"] == pytest.approx(2 * whole.about["hours"], abs=0.02)


def test_a_cell_stands_for_fewer_seeds_and_no_other_setting(cell):
    folder, config, _ = cell
    read = results.read(folder)
    assert read is not None
    assert read.stands_for(RunConfig(**config.to_dict() | {"seeds": 1})) == []
    other = RunConfig(**config.to_dict() | {"total_steps": 5})
    assert read.stands_for(other) == ["total_steps: 5 here, 1000000 there"]


def test_nothing_is_read_where_nothing_is_published(tmp_path):
    assert results.read(tmp_path) is None
