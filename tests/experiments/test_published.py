"""What is published of a run, against plain loops over its reports."""

import dataclasses
import itertools
import os
import shutil

import jax
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.experiments import experiment as catalogue
from hitmdp_jax.experiments import published
from hitmdp_jax.experiments.published import Cell, curves_of
from hitmdp_jax.interpret.summary import summarize
from hitmdp_jax.runs.config import RunConfig
from tests.cli.conftest import CHECKOUT
from tests.interpret.reports import made_up

TASK = {"name": "dmc/cheetah_run"}


def test_a_curve_holds_every_episode_once():
    metrics = made_up(np.random.default_rng(0))
    config = RunConfig(algo={"name": "mopg"}, env=TASK, seeds=3, seed=7, total_steps=150 * 2048)
    curves = curves_of(config, metrics)
    assert curves["env_steps"].shape == curves["episode_return"].shape == (3, published.POINTS)
    assert curves["env_steps"][1, -1] == 150 * 2048
    ends = np.searchsorted(metrics["env_steps"][1], curves["env_steps"][1])
    for point, (start, end) in enumerate(zip([-1, *ends[:-1]], ends, strict=True)):
        part = slice(start + 1, end + 1)
        episodes, values = metrics["episodes"][1, part], metrics["episode_return"][1, part]
        expected = np.nansum(episodes * values) / episodes.sum() if episodes.sum() else np.nan
        np.testing.assert_allclose(curves["episode_return"][1, point], expected, rtol=1e-12)


def test_no_point_of_a_curve_holds_episodes_of_both_tasks():
    metrics = made_up(np.random.default_rng(1), reports=250)  # 125 on each: no whole points
    first = np.arange(250) < 125
    metrics["episode_return"][:] = np.where(first, 279.0, 2.2)
    config = RunConfig(
        algo={"name": "mopg"}, env=TASK, second_env=TASK, seeds=3, total_steps=125 * 2048
    )
    curves = curves_of(config, metrics)
    after = curves["env_steps"] > config.switch_at
    assert after.shape == (3, published.POINTS)
    known = np.isfinite(curves["episode_return"])
    expected = np.where(after, 2.2, 279.0)
    np.testing.assert_allclose(curves["episode_return"][known], expected[known])


def cell_of(metrics, seed=3, **about):
    """A cell of the seeds from this one on."""
    config = RunConfig(
        algo={"name": "mopg"}, env={"name": "swimmer"}, seeds=len(metrics["env_steps"]), seed=seed
    )
    run = summarize(config, metrics)
    told = {"command": "train", "with": "this", "hours": 1.5, **about}
    return Cell(dataclasses.replace(run, about=told), curves_of(config, metrics))


def with_scores(cell, scores, **about):
    columns = cell.summary.columns | {"evaluation": np.array(scores)}
    told = cell.summary.about | about
    return Cell(dataclasses.replace(cell.summary, columns=columns, about=told), cell.curves)


def assert_same(found, expected):
    assert found.summary.config == expected.summary.config
    assert found.summary.about == expected.summary.about
    for mine, others in (
        (found.summary.columns, expected.summary.columns),
        (found.curves, expected.curves),
    ):
        assert set(mine) == set(others)
        for name, x in mine.items():
            np.testing.assert_allclose(x, others[name], rtol=1e-6)


def test_what_is_published_is_read_back_and_published_once(tmp_path):
    folder = tmp_path / "swimmer"
    mopg = with_scores(cell_of(made_up(np.random.default_rng(2), seeds=2)), [1.5, np.nan])
    ppo = cell_of(made_up(np.random.default_rng(3), seeds=4, options=0))
    published.publish(ppo, folder, "short, 10 steps")
    for _ in range(2):  # a second time replaces the first
        published.publish(mopg, folder, "mopg")
    read = published.read(folder)
    assert list(read) == ["short, 10 steps", "mopg"]
    assert_same(read["mopg"], mopg)
    assert_same(read["short, 10 steps"], ppo)
    assert [path.name for path in tmp_path.iterdir()] == ["swimmer"]
    assert {path.name for path in folder.iterdir()} == {"seeds.csv", "curves.csv", "runs.yaml"}


def test_a_sweeps_settings_are_read_back(tmp_path):
    config = RunConfig(algo={"name": "mopg"}, env=TASK, seeds=2, sweep={"algo.gamma": [0.9, 0.99]})
    metrics = made_up(np.random.default_rng(5), seeds=4)
    run = dataclasses.replace(summarize(config, metrics), about={"hours": 1.0})
    published.publish(Cell(run, curves_of(config, metrics)), tmp_path / "cheetah", "swept")
    (read,) = published.read(tmp_path / "cheetah").values()
    assert [x.returns.tolist() for x in read.summary.by_setting().values()] == [
        read.summary.returns[:2].tolist(),
        read.summary.returns[2:].tolist(),
    ]
    assert read.summary.columns["algo.gamma"].tolist() == [0.9, 0.9, 0.99, 0.99]


class KilledError(BaseException):
    """Ends a publication at one of its steps, as a kill does."""


def test_a_kill_at_any_step_of_a_publication_leaves_the_old_cell_or_the_new_one(tmp_path):
    folder = tmp_path / "results" / "swimmer"
    cell = cell_of(made_up(np.random.default_rng(2), seeds=2))
    old, new = with_scores(cell, [1.5, 1.5], day="old"), with_scores(cell, [2.5, 2.5], day="new")
    published.publish(old, folder, "mopg")
    published.publish(cell, folder, "ppo")
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
                more = lambda beside: (beside / "more").write_text("more")  # noqa: E731
                published.publish(new, folder, "mopg", more)
                seen.append("finished")
            except KilledError:
                there = published.read(folder)
                assert_same(there["ppo"], cell)
                day = there["mopg"].summary.about["day"]
                assert_same(there["mopg"], {"old": old, "new": new}[day])
                assert (folder / "more").exists() == (day == "new")
                seen.append(day)
        if seen[-1] != "old":
            published.publish(old, folder, "mopg", lambda beside: (beside / "more").unlink())
    assert seen[:-1] == sorted(seen[:-1], reverse=True)
    assert {"old", "new"} <= set(seen)
    assert [path.name for path in folder.parent.iterdir()] == ["swimmer"]


def test_seeds_that_follow_make_the_cell_that_all_at_once_would():
    metrics = made_up(np.random.default_rng(4), seeds=5)
    parts = {"all": slice(5), "first": slice(3), "rest": slice(3, 5)}

    def cell(name):
        part = parts[name]
        own = {k: x[part] for k, x in metrics.items()}
        of_seeds = cell_of(own, 3 + (part.start or 0), command=name)
        return with_scores(of_seeds, np.arange(5.0)[part])

    grown, whole = cell("first").followed_by(cell("rest")), cell("all")
    told = whole.summary.about | {"command": "first; rest", "hours": 3.0}
    assert_same(grown, Cell(dataclasses.replace(whole.summary, about=told), whole.curves))


def test_a_column_that_older_seeds_do_not_have_is_not_known_of_them():
    cell = cell_of(made_up(np.random.default_rng(4), seeds=2))
    grown = cell.followed_by(with_scores(cell, [1.0, 2.0]))
    np.testing.assert_array_equal(grown.summary.columns["evaluation"], [np.nan, np.nan, 1.0, 2.0])


def test_a_cell_stands_for_fewer_seeds_and_no_other_setting():
    cell = cell_of(made_up(np.random.default_rng(2), seeds=2))
    config = cell.summary.config
    assert cell.stands_for(RunConfig(**config.to_dict() | {"seeds": 1})) == []
    other = RunConfig(**config.to_dict() | {"total_steps": 5})
    assert cell.stands_for(other) == ["total_steps: 5 here, 1000000 there"]


def test_nothing_is_read_where_nothing_is_published(tmp_path):
    assert published.read(tmp_path / "none") == {}


@pytest.mark.whole
def test_published_policies_are_small_and_can_be_loaded():
    files = sorted((CHECKOUT / "results").glob("*/*.policy"))
    assert len(files) == 21
    for file in files:
        assert file.stat().st_size < 2**20
        policy = hitmdp_jax.load(file)  # which has it act, on shapes
        assert policy.spec.observation.size > 0
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(policy.params))


@pytest.mark.whole
def test_what_is_published_is_of_the_settings_that_its_experiment_has_today():
    """A cell of each algorithm: else 'hitmdp experiment' would refuse to go on with it."""
    seen = set()
    for experiment in catalogue.published().values():
        for task in experiment.tasks:
            cells = published.read(CHECKOUT / "results" / task)
            for arm in cells.keys() & experiment.arms.keys():
                name = cells[arm].summary.config.algo["name"]
                if name not in seen:
                    seen.add(name)
                    config = Settings(experiment.settings_of(task, arm)).config()
                    assert cells[arm].stands_for(config) == [], (task, arm)
    assert {"mopg", "ppo", "dac"} <= seen
