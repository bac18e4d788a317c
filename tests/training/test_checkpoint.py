import jax
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.checkpoint import KEPT, Checkpoints, Progress, saved_iterations
from tests.probes import Target

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


def test_the_newest_and_the_best_are_kept(checkpoints, tmp_path, state):
    returns = [1.0, 9.0, float("nan"), 3.0, 4.0, 5.0, 2.0]
    for i, recent_return in enumerate(returns, start=1):
        checkpoints.save(Progress(i, 0, marked(state, i)), recent_return)
    checkpoints.close()
    assert saved_iterations(tmp_path) == [2, *range(8 - KEPT, 8)]


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
