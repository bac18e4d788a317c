import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import MOPG
from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.program import (
    CAUSES,
    num_iterations,
    repeat,
    transfer,
)
from tests.probes import Counter, PlaygroundTarget, Target

AGENT = MOPG(num_epochs=2)
SIZES = {"num_envs": 8, "rollout_length": 16}


def assert_close(x, y, **tolerance):
    def compare(a, b):
        if jax.dtypes.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        np.testing.assert_allclose(a, b, **tolerance)

    jax.tree.map(compare, x, y)


def test_train_is_init_and_repeated_steps(key):
    init, step = hitmdp_jax.make_train(AGENT, Target(), num_steps=3 * 128, **SIZES)
    state = init(key)
    for _ in range(3):
        state, metrics = step(state)
    whole, all_metrics = jax.jit(
        lambda k: hitmdp_jax.train(AGENT, Target(), k, num_steps=3 * 128, **SIZES)
    )(key)
    assert_close(whole, state, rtol=1e-3, atol=1e-5)
    assert_close(jax.tree.map(lambda x: x[-1], all_metrics), metrics, rtol=1e-3, atol=1e-4)


def test_a_playground_environment_trains_as_one_of_brax_does(key):
    def returns(env):
        sizes = SIZES | {"num_steps": 3 * 128, "episode_length": 10}
        return jax.jit(lambda k: hitmdp_jax.train(AGENT, env, k, **sizes))(key)[1]["episode_return"]

    np.testing.assert_allclose(returns(PlaygroundTarget()), returns(Target()), rtol=1e-3)


def test_observations_of_several_arrays_are_refused():
    env = PlaygroundTarget()
    env.observation_size = {"state": 1, "privileged_state": 2}
    with pytest.raises(UsageError, match="several arrays"):
        hitmdp_jax.make_train(AGENT, env, num_steps=128, **SIZES)


def test_repeated_iterations_sum_up_their_metrics(key):
    init, step = hitmdp_jax.make_train(AGENT, Target(), num_steps=3 * 128, **SIZES)
    state, each = jax.lax.scan(lambda s, _: step(s), init(key), length=3)
    again, together = repeat(step, 3)(init(key))
    assert_close(again, state, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(together["option_steps"], each["option_steps"].sum(0))
    np.testing.assert_allclose(together["episodes"], each["episodes"].sum())
    np.testing.assert_allclose(
        together["episode_return"],
        np.average(each["episode_return"], weights=each["episodes"]),
        rtol=1e-5,
    )
    np.testing.assert_allclose(together["value_loss"], each["value_loss"].mean(), rtol=1e-5)


def test_a_transfer_keeps_what_was_learned_and_restarts_the_rest(key):
    init, step = hitmdp_jax.make_train(AGENT, Target(), num_steps=128, **SIZES)
    old = step(init(key))[0]
    fresh = init(jax.random.key(9))
    new = transfer(old, fresh)
    assert_close((new.learner, new.normalizer, new.key), (old.learner, old.normalizer, old.key))
    assert_close(new.rollout, fresh.rollout)
    assert new.iteration == 1


def test_a_seed_among_others_equals_the_seed_alone():
    env = hitmdp_jax.make_env("invertedpendulum", physics="native")

    def train(key):
        return hitmdp_jax.train(AGENT, env, key, num_steps=2 * 128, **SIZES)

    keys = jax.vmap(jax.random.key)(jnp.arange(4))
    together = jax.jit(jax.vmap(train))(keys)
    alone = jax.jit(train)(keys[3])
    assert_close(jax.tree.map(lambda x: x[3], together), alone, rtol=1e-3, atol=1e-4)


def test_the_same_seed_gives_the_same_result(key):
    train = jax.jit(lambda k: hitmdp_jax.train(AGENT, Target(), k, num_steps=128, **SIZES))
    assert_close(train(key), train(key), rtol=0)
    other = train(jax.random.key(1))[0].learner.params["embeddings"]
    assert not np.allclose(train(key)[0].learner.params["embeddings"], other)


def test_agents_and_keys_map_together():
    """The sweep of the design: one compiled program over hyperparameters and seeds."""
    agents = jax.vmap(lambda rate: AGENT.replace(learning_rate=rate))(jnp.array([0.0, 1e-3]))
    keys = jax.random.split(jax.random.key(0), 2)
    _, metrics = jax.jit(
        jax.vmap(lambda a, k: hitmdp_jax.train(a, Target(), k, num_steps=256, **SIZES))
    )(agents, keys)
    assert metrics["episode_return"].shape == (2, 2)
    assert (metrics["action_kl"][0] < 1e-6).all()
    assert (metrics["action_kl"][1, 1:] > 1e-6).all()


def test_normaliser_equals_the_observations_statistics(key):
    """Target draws a new observation in [-1, 1] at every step: mean 0, variance 1/3."""
    init, step = hitmdp_jax.make_train(
        AGENT, Target(), num_steps=1024, num_envs=64, rollout_length=16, reset_pool_size=1024
    )
    state = step(init(key))[0]
    assert float(state.normalizer.std[0]) == pytest.approx(np.sqrt(1 / 3), abs=0.03)
    assert float(state.normalizer.mean[0]) == pytest.approx(0.0, abs=0.06)


def test_no_episode_ended_is_reported_as_nan(key):
    train = jax.jit(
        lambda k: hitmdp_jax.train(
            AGENT, Counter(), k, num_steps=128, episode_length=1000, stagger=False, **SIZES
        )
    )
    metrics = train(key)[1]
    assert np.isnan(metrics["episode_return"]).all()
    assert (metrics["episodes"] == 0).all()


def test_recent_returns_are_carried_over_iterations_without_an_end(key):
    sizes = SIZES | {"num_steps": 8 * 128, "episode_length": 40, "stagger": False}
    metrics = jax.jit(lambda k: hitmdp_jax.train(AGENT, Counter(), k, **sizes))(key)[1]
    ended = np.asarray(metrics["episodes"]) > 0
    assert ended.any()
    assert not ended.all()
    first = int(np.argmax(ended))
    assert np.isnan(metrics["recent_return"][:first]).all()
    np.testing.assert_allclose(metrics["recent_return"][first:], 40.0)  # a reward of 1 a step


class Poison(Target):
    """The reward is NaN from the tenth step on in an episode that started below a threshold."""

    episode_length = 1000

    def __init__(self, threshold):
        self.threshold = threshold

    def reset(self, rng):
        return super().reset(rng).replace(info={"clock": jnp.zeros(())})

    def step(self, state, action):
        clock = state.info["clock"] + 1
        poisoned = (clock >= 10) & (state.obs[0] < self.threshold)
        reward = jnp.where(poisoned, jnp.nan, 1.0)
        return state.replace(reward=reward, done=jnp.zeros(()), info={"clock": clock})


def test_a_run_that_is_not_finite_keeps_its_last_finite_state_and_harms_no_other():
    sizes = {"num_steps": 3 * 64, "num_envs": 8, "rollout_length": 8}

    @functools.partial(jax.jit, static_argnums=2)
    def run(threshold, keys, length):
        init, step = hitmdp_jax.make_train(AGENT, Poison(threshold), **sizes)
        states = jax.vmap(init)(keys)
        return jax.lax.scan(lambda s, _: jax.vmap(step)(s), states, length=length)

    keys = jax.vmap(jax.random.key)(jnp.arange(6))
    together, metrics = run(-0.9, keys, 3)
    lost = np.asarray(together.diverged) > 0
    assert lost.any()
    assert not lost.all()
    assert set(np.asarray(together.diverged)[lost]) == {2}
    assert {CAUSES[i] for i in np.asarray(together.cause)[lost]} == {"reward"}
    told = np.asarray(metrics["diverged"])
    assert told[:, lost].all(axis=1).tolist() == [False, True, True]
    assert not told[:, ~lost].any()
    assert np.isnan(metrics["value_loss"][1:, lost]).all()
    assert (np.asarray(metrics["option_steps"])[1:, lost] == 0).all()
    # A lost seed's parameters are those after its only finite iteration.
    once, thrice = (jax.tree.leaves(s.learner) for s in (run(-0.9, keys, 1)[0], together))
    for one, three in zip(once, thrice, strict=True):
        np.testing.assert_allclose(one[lost], three[lost], rtol=1e-4, atol=1e-6)
        assert np.isfinite(three).all()
    # The others are bit for bit what they are where nobody diverges.
    sound = jax.tree.leaves(run(-2.0, keys, 3)[0].learner)
    for one, three in zip(sound, thrice, strict=True):
        np.testing.assert_array_equal(one[~lost], three[~lost])


def test_the_agent_that_acts_is_the_scheduled_one(key):
    """Options are drawn at random once the similarity has been annealed to zero."""

    class Annealed(MOPG):
        def scheduled(self, progress):
            return self.replace(similarity=jnp.where(progress < 0.5, 50.0, 0.0))

    sizes = {"num_envs": 8, "rollout_length": 16, "num_steps": 2 * 128}
    agent = Annealed(num_epochs=1, learning_rate=0.0)
    env = Counter()  # episodes of five steps
    _, metrics = jax.jit(lambda k: hitmdp_jax.train(agent, env, k, **sizes))(key)
    durations = 128 / np.asarray(metrics["option_activations"]).sum(1)
    assert durations[0] > 3.0
    assert durations[1] < 2.0


def test_an_agents_class_is_not_an_agent():
    with pytest.raises(UsageError, match=r"agent is the class MOPG: pass an agent, MOPG\(\)"):
        hitmdp_jax.make_train(MOPG, Target(), num_steps=128, **SIZES)


def test_iterations_cover_the_steps():
    assert num_iterations(1_000_000, 16, 128) == 489
    assert num_iterations(2048, 16, 128) == 1


@pytest.mark.parametrize(
    ("sizes", "sentence"),
    [
        ({"num_envs": 3, "rollout_length": 100}, "3 = 300 is not divisible by minibatch_size = 64"),
        ({"num_envs": 0}, "num_envs = 0 must be a positive whole number"),
        ({"rollout_length": -5}, "rollout_length = -5 must be a positive whole number"),
        ({"rollout_length": "a"}, "rollout_length = a must be a positive whole number"),
        ({"num_envs": 2.5}, "num_envs = 2.5 must be a positive whole number"),
        ({"num_envs": True}, "num_envs = True must be a positive whole number"),
    ],
)
def test_sizes_that_do_not_fit_are_explained(sizes, sentence):
    with pytest.raises(UsageError, match=sentence):
        hitmdp_jax.make_train(MOPG(), Target(), num_steps=10, **sizes)
