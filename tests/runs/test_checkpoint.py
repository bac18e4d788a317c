import os
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme.running_statistics import RunningStatisticsState
from flax import struct

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.normalization import statistics_of
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress, saved_iterations
from tests.probes import Target, spec_of_sizes

INIT, STEP = hitmdp_jax.make_train(PPO(num_epochs=1), Target(), num_steps=64, num_envs=4,
                                   rollout_length=16)  # fmt: skip


@pytest.fixture(scope="module")
def state():
    return jax.jit(jax.vmap(INIT))(jax.random.split(jax.random.key(0), 2))


def like(task):
    return jax.eval_shape(jax.vmap(INIT), jax.random.split(jax.random.key(0), 2))


@pytest.fixture
def checkpoints(tmp_path):
    opened = Checkpoints(tmp_path)
    yield opened
    opened.close()


def marked(state, number):
    return state.replace(iteration=np.full(2, number, np.int32))


def test_a_state_comes_back_as_it_was(checkpoints, state):
    checkpoints.save(Progress(3, 1, state))
    progress = checkpoints.restore(like)
    assert (progress.iteration, progress.task) == (3, 1)
    raw = [s.replace(key=jax.random.key_data(s.key)) for s in (state, progress.state)]
    jax.tree.map(np.testing.assert_array_equal, *raw)


class Empty(Target):
    """A task whose states have an array without entries, as those of a simulator do."""

    def reset(self, rng):
        return super().reset(rng).replace(pipeline_state={"act": jnp.zeros((0, 3))})


def test_arrays_without_entries_come_back(checkpoints):
    init, _ = hitmdp_jax.make_train(PPO(num_epochs=1), Empty(), num_steps=64, num_envs=4,
                                    rollout_length=16)  # fmt: skip
    keys = jax.random.split(jax.random.key(0), 2)
    state = jax.jit(jax.vmap(init))(keys)
    checkpoints.save(Progress(3, 0, state))
    back = checkpoints.restore(lambda task: jax.eval_shape(jax.vmap(init), keys)).state
    assert checkpoints.is_whole(3)
    assert back.rollout.env.env.pipeline_state["act"].shape == (2, 4, 0, 3)
    jax.tree.map(np.testing.assert_array_equal, back.learner.params, state.learner.params)
    assert checkpoints.failure is None


NAN = float("nan")


@pytest.mark.parametrize(
    ("returns", "kept", "best"),
    [
        ([NAN, 5, 9, 1, 2, 3], [3, 4, 5, 6], 3),
        ([1, 9, NAN, 3, 4, 5, 2], [2, 5, 6, 7], 2),
        ([4, 4, 1, 1, 1], [2, 3, 4, 5], 2),  # of equal ones the newest
        ([NAN, NAN, NAN, NAN], [2, 3, 4], 4),
        ([-5, NAN, NAN, NAN, -7], [1, 3, 4, 5], 1),
    ],
)
@pytest.mark.parametrize("resumed", [False, True])
def test_the_newest_and_the_best_are_kept(returns, kept, best, resumed, tmp_path, state):
    checkpoints = Checkpoints(tmp_path)
    for i, recent_return in enumerate(returns, start=1):
        checkpoints.save(Progress(i, 0, marked(state, i)), recent_return)
        if resumed and i > 2:
            checkpoints.close()
            checkpoints = Checkpoints(tmp_path)
    checkpoints.close()
    assert saved_iterations(tmp_path) == kept
    assert Checkpoints(tmp_path, read_only=True).restore_policy("best")[0] == best


def test_each_task_of_a_transfer_has_its_best_which_is_asked_for_by_its_place(tmp_path, state):
    checkpoints = Checkpoints(tmp_path)
    returns = [(0, 300), (0, 345), (0, 100), (1, NAN), (1, 7), (1, 3), (1, 2), (1, 1)]
    for i, (task, recent_return) in enumerate(returns, start=1):
        checkpoints.save(Progress(i, task, marked(state, i)), recent_return)
    checkpoints.close()
    assert saved_iterations(tmp_path) == [2, 5, 6, 7, 8]
    reader = Checkpoints(tmp_path, read_only=True)
    asked = [("best", None), ("best", 0), ("best", 1), ("newest", 0), ("newest", 1)]
    assert [reader.restore_policy(*each)[0] for each in asked] == [5, 2, 5, 2, 8]
    with pytest.raises(UsageError, match="holds no checkpoint best of task 2"):
        reader.restore_policy("best", 2)


class Learner(struct.PyTreeNode):
    params: dict


class Small(struct.PyTreeNode):
    """What a checkpoint needs of a state: its files are of the same kinds, and read quickly."""

    key: jax.Array
    own: jax.Array  # keys that a task's state holds
    learner: Learner
    normalizer: RunningStatisticsState
    spec: Spec = struct.field(pytree_node=False, default=spec_of_sizes(3, 1))

    @classmethod
    def at(cls, iteration):
        of_observations = jnp.full((2, 3), iteration, jnp.float32)
        params = {"w": jax.random.normal(jax.random.key(iteration), (2, 50))}
        keys = jax.random.split(jax.random.key(0), 2)
        count = jnp.full(2, iteration, jnp.float32)
        normalizer = statistics_of(of_observations, of_observations, count)
        own = jax.random.split(jax.random.key(iteration), 2)
        return cls(keys, own, Learner(params), normalizer)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """A run of two checkpoints that hold different policies."""
    folder = tmp_path_factory.mktemp("two")
    checkpoints = Checkpoints(folder)
    for i in (1, 2):
        checkpoints.save(Progress(i, 0, Small.at(i)))
    checkpoints.close()
    return folder


def test_all_keys_of_a_state_are_saved_as_keys(two):
    """Those of the task too: gymnax's tasks and Playground's draw by keys of their own."""
    read = Checkpoints(two, read_only=True).restore(lambda _: jax.eval_shape(lambda: Small.at(1)))
    for name in ("key", "own"):
        found, saved = (getattr(state, name) for state in (read.state, Small.at(2)))
        assert found.dtype == saved.dtype
        np.testing.assert_array_equal(jax.random.key_data(found), jax.random.key_data(saved))


def flipped(content, places):
    """Return a file's content with one bit changed, at several places."""
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(content), places):
        bit = 1 << int(rng.integers(8))
        yield content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :]


def torn(content, ways):
    every = (content[: len(content) // 2], b"", content[:-1], b"\0" * len(content), b"\xff[")
    yield from every[:ways]


SOME = [(flipped, 2), (torn, 1)]
MANY = [pytest.param(damage, 40, marks=pytest.mark.slow) for damage, _ in SOME]


@pytest.mark.parametrize(("damage", "number"), [*SOME, *MANY])
def test_damage_in_any_file_is_noticed(damage, number, two, tmp_path, capfd):
    """A checkpoint is as it was, or it gives way to the one before, and that is told in a line."""
    shapes = jax.eval_shape(lambda: Small.at(1))
    run_dir = shutil.copytree(two, tmp_path / "run")
    files = sorted(p for p in (run_dir / "checkpoints" / "2").rglob("*") if p.is_file())
    assert len(files) > 20
    for path in files:
        whole = path.read_bytes()
        for content in damage(whole, number):
            path.write_bytes(content)
            if "state" in path.parts:
                progress = Checkpoints(run_dir).restore(lambda task: shapes)
                iteration, read = progress.iteration, progress.state.learner.params
                if iteration == 1:  # which removes the damaged one
                    shutil.copytree(two, run_dir, dirs_exist_ok=True)
            else:
                reader = Checkpoints(run_dir, read_only=True)
                iteration, policy, _ = reader.restore_policy()
                read = policy["params"]
                if iteration == 1:
                    with pytest.raises(UsageError):  # in one sentence
                        reader.restore_policy(2)
            np.testing.assert_array_equal(read["w"], Small.at(iteration).learner.params["w"])
            assert capfd.readouterr().err.count("\n") == (iteration == 1), path
        path.write_bytes(whole)


@pytest.mark.parametrize("read_only", [True, False])
def test_what_may_never_end_is_not_read(two, tmp_path, read_only):
    """Whichever of a checkpoint's files is a pipe, or lies in a folder that is a link."""
    run_dir = shutil.copytree(two, tmp_path / "run")
    paths = sorted((run_dir / "checkpoints").rglob("*"))
    assert len(paths) > 40
    for path in paths:
        aside = path.rename(tmp_path / "aside")
        os.mkfifo(path)
        with pytest.raises(UsageError, match=f"'{path}' cannot be read: it is a pipe"):
            Checkpoints(run_dir, read_only)
        path.unlink()
        if aside.is_dir() and read_only:  # whoever writes follows no link at all (test_folder.py)
            path.symlink_to(aside)
            with pytest.raises(UsageError, match=f"'{path}' cannot be read: it is a link"):
                Checkpoints(run_dir, read_only)
            path.unlink()
        aside.rename(path)
    assert Checkpoints(run_dir, read_only).restore_policy()[0] == 2


def test_a_seed_that_is_not_finite_keeps_no_other_from_being_saved(checkpoints, tmp_path, state):
    """What a seed had learned is kept by `freeze_diverged`; whatever a state holds is saved."""
    normalizer = state.normalizer.replace(mean=state.normalizer.mean.at[0].set(np.nan))
    checkpoints.save(Progress(2, 0, state.replace(normalizer=normalizer)))
    checkpoints.close()
    assert saved_iterations(tmp_path) == [2]
    assert checkpoints.failure is None
    mean = Checkpoints(tmp_path, read_only=True).restore_policy()[1]["mean"]
    assert np.isfinite(mean[:, 0]).tolist() == [False, True]


def test_a_torn_checkpoint_gives_way_to_the_one_before(tmp_path, state, capsys):
    checkpoints = Checkpoints(tmp_path)
    for i in (1, 2):
        checkpoints.save(Progress(i, 0, marked(state, i)))
    checkpoints.close()
    for path in (tmp_path / "checkpoints" / "2").rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    checkpoints = Checkpoints(tmp_path)
    assert checkpoints.restore(like).iteration == 1
    assert "checkpoint of iteration 2" in capsys.readouterr().err
    checkpoints.save(Progress(2, 0, marked(state, 2)))  # room for it again
    checkpoints.close()
    assert Checkpoints(tmp_path).restore(like).iteration == 2


def test_another_shape_is_explained(checkpoints, state):
    checkpoints.save(Progress(1, 0, state))
    init, _ = hitmdp_jax.make_train(
        PPO(num_epochs=1, hidden_sizes=(8, 8)), Target(), num_steps=64, num_envs=4,
        rollout_length=16,
    )  # fmt: skip
    keys = jax.random.split(jax.random.key(0), 2)
    with pytest.raises(UsageError, match=r"not fit its config.yaml: .* is an array \[2, 8709\]"):
        checkpoints.restore(lambda task: jax.eval_shape(jax.vmap(init), keys))


def test_a_checkpoint_that_is_not_there_is_explained(checkpoints, tmp_path, state):
    with pytest.raises(UsageError, match="holds no checkpoint"):
        checkpoints.restore(like)
    checkpoints.save(Progress(4, 0, state))
    checkpoints.close()
    with pytest.raises(UsageError, match="holds no checkpoint 7; it holds 4"):
        Checkpoints(tmp_path).restore_policy(7)
    with pytest.raises(UsageError, match="holds no checkpoint"):
        Checkpoints(tmp_path / "nowhere", read_only=True)
    assert Checkpoints(tmp_path).restore_policy("best")[1]["mean"].shape == (2, 1)


def test_a_full_disk_is_told_once_and_ends_nothing(checkpoints, monkeypatch, state, capsys):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoints._manager, "save", full)
    for i in (1, 2):
        checkpoints.save(Progress(i, 0, state))
    assert "No space left on device" in checkpoints.failure
    assert capsys.readouterr().err.count("could not be written") == 1
