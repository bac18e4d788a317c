"""`train` with callbacks, against the same training as one compiled function."""

import jax
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax import UsageError
from hitmdp_jax.agents import PPO
from tests.probes import Remembering, Target

AGENT = PPO(num_epochs=2, hidden_sizes=(8,), learning_rate=1e-3)
SIZES = {"num_steps": 4 * 128, "num_envs": 8, "rollout_length": 16}


class Reads(hitmdp_jax.Callback):
    """Keeps what it is shown, and reports one number of it."""

    every, names = 256, ("first_weight",)

    def __init__(self):
        self.seen, self.closed = [], False

    def __call__(self, now):
        self.seen.append(now)
        return {"first_weight": first_weight(now.policy.params)}

    def close(self):
        self.closed = True


class Stops(hitmdp_jax.Callback):
    every = 1

    def __call__(self, now):
        if now.env_steps == 256:
            now.stop()


def first_weight(params):
    """Return a number [R] of parameters [R, ...]."""
    kernel = next(x for x in jax.tree.leaves(params) if x.ndim == 3)
    return np.asarray(kernel[:, 0, 0])


@pytest.fixture(scope="module")
def keys():
    return jax.random.split(jax.random.key(5), 2)


@pytest.fixture(scope="module")
def history(keys):
    """Two trainings that nobody looks at."""
    return jax.jit(jax.vmap(lambda key: hitmdp_jax.train(AGENT, Target(), key, **SIZES)))(keys)


def assert_same(mine, other):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6), mine, other)


@pytest.mark.whole
def test_whoever_looks_changes_nothing(keys, history):
    reads = Reads()
    state, metrics = hitmdp_jax.train(AGENT, Target(), keys, callbacks=[reads], **SIZES)
    read = metrics.pop("first_weight")
    assert metrics.keys() == history[1].keys()
    assert_same((state.learner, metrics), (history[0].learner, history[1]))
    assert [(now.env_steps, now.iteration) for now in reads.seen] == [(256, 2), (512, 4)]
    assert_same(dict(reads.seen[1].metrics), {name: x[:, 3] for name, x in metrics.items()})
    assert_same(reads.seen[1].policy.params, state.learner.params)
    assert reads.seen[1].policy.of(0).spec == state.spec
    assert np.isnan(read[:, ::2]).all()
    np.testing.assert_array_equal(read[:, 3], first_weight(state.learner.params))
    assert reads.closed


def test_of_one_key_a_callback_sees_one_training_and_may_end_it(keys, history):
    reads, key = Reads(), keys[1]
    both = [reads, Stops()]
    state, metrics = hitmdp_jax.train(AGENT, Target(), key, callbacks=both, **SIZES)
    assert int(state.iteration) == 2
    assert metrics["first_weight"].shape == (2,)
    assert_same(metrics["loss"], history[1]["loss"][1, :2])
    assert reads.seen[0].metrics["loss"].shape == (1,)
    assert reads.closed


def test_a_training_ends_at_its_return(keys, history):
    returns = np.asarray(history[1]["recent_return"][0])
    best = float(returns.max())
    _, metrics = hitmdp_jax.train(AGENT, Target(), keys[0], stop_at_return=best - 1e-4, **SIZES)
    assert metrics["recent_return"].shape == (returns.argmax() + 1,)
    _, metrics = hitmdp_jax.train(AGENT, Target(), keys[0], stop_at_return=best + 1, **SIZES)
    assert_same(metrics["recent_return"], returns)


@pytest.mark.whole
def test_a_replay_whose_memory_is_reused_holds_what_it_would(keys):
    agent = Remembering(num_epochs=1, hidden_sizes=(8,))
    state, _ = hitmdp_jax.train(agent, Target(), keys[0], stop_at_return=1e9, **SIZES)
    alone, _ = jax.jit(lambda key: hitmdp_jax.train(agent, Target(), key, **SIZES))(keys[0])
    assert jax.tree.leaves(alone.replay)
    assert_same(state.replay, alone.replay)


def of_a_number(how):
    """Train as a function of a number: the seed, a hyperparameter, or the task's."""

    def train(x):
        agent, env, key = AGENT, Target(), jax.random.key(0)
        if how == "seed":
            key = jax.random.fold_in(key, x.astype(int))
        elif how == "learning_rate":
            agent = AGENT.replace(learning_rate=x)
        else:
            env.scale = x
        return hitmdp_jax.train(agent, env, key, callbacks=[Reads()], **SIZES)[1]["loss"]

    return train


@pytest.mark.parametrize("how", ["seed", "learning_rate", "task"])
@pytest.mark.parametrize("transform", [jax.jit, jax.vmap])
def test_nobody_looks_into_a_traced_training(how, transform):
    with pytest.raises(UsageError, match=r"outside of jax\.jit and jax\.vmap"):
        transform(of_a_number(how))(np.zeros(2)[0] if transform is jax.jit else np.zeros(2))


@pytest.mark.parametrize(("options", "sentence"), [
    ({"callbacks": [Reads]}, r"callbacks holds the class Reads: pass a callback, Reads\(\)"),
    ({"callbacks": [print]}, "print is no callback"),
    ({"callbacks": [Reads(), Reads()]}, "'first_weight' twice"),
    ({"stop_at_return": "high"}, "stop_at_return = high"),
    ({"stop_at_return": float("nan")}, "stop_at_return = nan"),
])  # fmt: skip
def test_what_cannot_be_called_is_said_before_anything_is_compiled(options, sentence, key):
    with pytest.raises(UsageError, match=sentence):
        hitmdp_jax.train(AGENT, Target(), key, **options, **SIZES)
