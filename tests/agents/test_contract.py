"""What every agent owes, whichever it is."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import AGENTS
from hitmdp_jax.agents.option_agent import ClippedOptionAgent
from hitmdp_jax.errors import UsageError
from tests.agents.compiled import Compiled
from tests.probes import Target

SIZES = {"num_envs": 8, "rollout_length": 16}


# One gradient step an iteration instead of 2 epochs of 2: smaller iterations, and more of them.
SINGLE_STEP = {"num_envs": 8, "rollout_length": 4}


@pytest.fixture(params=sorted(AGENTS))
def name(request):
    return request.param


@pytest.fixture
def agent(name):
    return make_agent(name)


def make_agent(name):
    agent = AGENTS[name]()
    return agent.replace(num_epochs=2) if hasattr(agent, "num_epochs") else agent


@pytest.mark.parametrize("batch_shape", [(), (3,), (2, 3)])
def test_act_takes_any_batch_shape(agent, key, batch_shape):
    """Shapes alone are asked for, so nothing is compiled."""

    def act(key):
        params = agent.init(key, observation_size=5, action_size=2).params
        memory = agent.initial_memory(key, batch_shape)
        return memory, *agent.act(params, jnp.ones((*batch_shape, 5)), memory, key)

    memory, action, new_memory, _ = jax.eval_shape(act, key)
    assert action.shape == (*batch_shape, 2)
    assert jax.tree.map(jnp.shape, memory) == jax.tree.map(jnp.shape, new_memory)


def test_deterministic_actions_repeat(agent, key):
    agent = Compiled(agent)
    params = agent.init(key, 5, 2).params
    memory = agent.initial_memory(key, (2, 3))
    actions = [
        agent.act(params, jnp.ones((2, 3, 5)), memory, jax.random.key(i), deterministic=True)[0]
        for i in range(2)
    ]
    np.testing.assert_array_equal(*actions)


def test_iteration_keeps_structure_shapes_and_types(agent, key):
    init, step = hitmdp_jax.make_train(agent, Target(), num_steps=128, **SIZES)
    before = jax.eval_shape(init, key)
    after, metrics = jax.eval_shape(step, before)
    assert jax.tree.structure(before) == jax.tree.structure(after)
    assert [(x.shape, x.dtype) for x in jax.tree.leaves(before)] == [
        (x.shape, x.dtype) for x in jax.tree.leaves(after)
    ]
    assert {"episode_return", "episode_length", "episodes"} <= metrics.keys()


@pytest.fixture(scope="module")
def learnt():
    """Return the metrics of a run that learns, by agent: one program, and one run, for each.

    Separate networks for K options see a part of the samples each and take twice the iterations.
    """

    @functools.cache
    def learn(name):
        agent = make_agent(name)
        sizes, iterations = (SIZES, 80) if hasattr(agent, "num_epochs") else (SINGLE_STEP, 800)
        if isinstance(agent, ClippedOptionAgent):
            iterations = 160
        train = jax.jit(
            lambda k: hitmdp_jax.train(
                agent.replace(learning_rate=1e-3),
                Target(),
                k,
                num_steps=iterations * sizes["num_envs"] * sizes["rollout_length"],
                reset_pool_size=128,
                **sizes,
            )
        )
        return jax.device_get(train(jax.random.key(0))[1])

    return learn


def test_metrics_are_finite(name, learnt):
    for metric, value in learnt(name).items():
        assert np.isfinite(value).all(), metric


def test_float_hyperparameters_are_leaves_and_the_rest_is_static(agent):
    floats = [f for f in dataclasses.fields(agent) if isinstance(f.default, float)]
    assert len(jax.tree.leaves(agent)) == len(floats)
    clipped = {"clip_eps"} if hasattr(agent, "num_epochs") else set()
    assert {"learning_rate", "gamma"} | clipped <= {f.name for f in floats}


def test_two_learning_rates_train_in_one_program(agent, key):
    rates = jnp.array([0.0, 3e-3])
    init, _ = hitmdp_jax.make_train(agent, Target(), num_steps=128, **SIZES)
    untrained = jax.jit(init)(key).learner.params
    state, _ = jax.jit(
        jax.vmap(
            lambda rate: hitmdp_jax.train(
                agent.replace(learning_rate=rate), Target(), key, num_steps=128, **SIZES
            )
        )
    )(rates)
    trained = state.learner.params
    same = jax.tree.map(lambda x, y: np.allclose(x[0], y, atol=1e-6), trained, untrained)
    moved = jax.tree.map(lambda x, y: not np.allclose(x[1], y, atol=1e-6), trained, untrained)
    assert all(jax.tree.leaves(same))
    assert any(jax.tree.leaves(moved))


def test_learns_to_hit_the_target(name, learnt):
    """The best return is 1; the first policy's is 1 - 1/3 - its variance, at most 0.3."""
    returns = learnt(name)["episode_return"].reshape(80, -1).mean(1)
    assert returns[:3].mean() < 0.55
    assert returns[-5:].mean() > 0.75


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"learning_rate": -1.0}, "learning_rate = -1.0 must be a finite number from 0"),
        ({"learning_rate": float("inf")}, "learning_rate = inf must be a finite number from 0"),
        ({"learning_rate": "a"}, "learning_rate = a must be a finite number from 0"),
        ({"learning_rate": None}, "learning_rate = None must be a finite number from 0"),
        ({"learning_rate": True}, "learning_rate = True must be a finite number from 0"),
        ({"gamma": 1.5}, "gamma = 1.5 must be a number from 0 to 1"),
        ({"gamma": float("nan")}, "gamma = nan must be a number from 0 to 1"),
        ({"hidden_sizes": (64, -1)}, "must be a list of positive whole numbers"),
        ({"hidden_sizes": 64}, "hidden_sizes = 64 must be a list of positive whole numbers"),
        ({"hidden_sizes": ()}, "must be a list of positive whole numbers"),
        ({"activation": "rely"}, "did you mean 'relu'"),
        ({"bootstrap_on_truncation": 1}, "bootstrap_on_truncation = 1 must be true or false"),
    ],
)
def test_bad_hyperparameters_are_explained(agent, change, sentence):
    with pytest.raises(UsageError, match=sentence):
        agent.replace(**change)


def test_bad_sizes_are_explained(agent):
    """Every whole number of an agent, whichever it has."""
    for field in dataclasses.fields(agent):
        if isinstance(field.default, int) and not isinstance(field.default, bool):
            sentence = f"{field.name} = 0 must be a positive whole number"
            with pytest.raises(UsageError, match=sentence):
                agent.replace(**{field.name: 0})


def test_executed_options_and_their_probabilities_agree(agent, key):
    """An option that was executed is an index, and its probability is not zero."""
    agent = Compiled(agent)
    params = agent.init(key, 5, 2).params
    memory, obs = agent.initial_memory(key, (2, 3)), jax.random.normal(key, (2, 3, 5))
    _, _, record = agent.act(params, obs, memory, key)
    option, probs = agent.option_of(record), agent.option_probs(params, obs, memory)
    if option is None:
        assert probs is None
        return
    assert option.shape == (2, 3)
    assert probs.shape == (2, 3, agent.num_options)
    np.testing.assert_allclose(probs.sum(-1), 1.0, rtol=1e-5)
    assert (jnp.take_along_axis(probs, option[..., None], axis=-1) > 0).all()


def test_rollouts_that_do_not_divide_are_refused(agent):
    if not hasattr(agent, "minibatch_size"):
        agent.check_batch(101)
        return
    sentence = "2 \\* 50 = 100 is not divisible by minibatch_size = 64; the nearest .* is 50"
    with pytest.raises(UsageError, match=sentence):
        agent.check_batch(100, "2 * 50")
