"""The policy of HiT-MDPs: its memory, its options and the shapes it takes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOPG
from tests.agents.compiled import Compiled
from tests.agents.option_batches import A, B, K, O, T, random_params


@pytest.fixture
def agent():
    return Compiled(MOPG())


def test_initial_options_are_uniform(agent, key):
    options = agent.initial_memory(key, (4000,))
    np.testing.assert_allclose(np.bincount(options) / 4000, 0.25, atol=0.03)


def test_memory_is_the_option_taken(agent, key, params):
    memory = jnp.zeros(64, jnp.int32)
    _, new_memory, record = agent.act(params, jnp.ones((64, O)), memory, key)
    np.testing.assert_array_equal(new_memory, record)


def test_the_first_options_of_the_paper_are_option_zero(key):
    assert not MOPG(initial_option="first").initial_memory(key, (4,)).any()


def test_memory_of_order_three_holds_the_last_three_options():
    agent = MOPG(value_order=3)
    memory = jnp.zeros((), jnp.int32)
    for option in (1, 2, 3):
        memory = agent.remember(memory, jnp.array(option))
    assert int(memory) == 3 + 4 * 2 + 16 * 1
    assert int(agent.previous_option(memory)) == 3
    assert int(agent.remember(memory, jnp.array(0))) == 0 + 4 * 3 + 16 * 2


def test_values_of_order_two_depend_on_both_options(key):
    agent = Compiled(MOPG(value_order=2))
    params = agent.init(key, O, A).params
    obs = jax.random.normal(key, (B, O))
    options, memory = jnp.array([0, 1, 2]), jnp.array([3, 2, 1])
    every = agent.every_q(params, obs, memory)
    for b, (option, previous) in enumerate(zip(options, memory, strict=True)):
        # Q_O[s, o_t, o_{t-1}]
        one = agent.q(params, obs[b][None], (option + K * previous)[None])
        np.testing.assert_allclose(every[b, option], one[0], rtol=1e-5)
        without = agent.q(params, obs[b][None], option[None])
        assert not np.allclose(every[b, option], without)


@pytest.mark.parametrize("form", ["similarity", "printed"])
def test_parts_take_any_batch_shape(form, key):
    agent = Compiled(MOPG(master_policy=form))
    params = random_params(agent, key)
    obs = jax.random.normal(key, (T, B, O))
    option = jax.random.randint(key, (T, B), 0, K)
    parts = {
        "option": lambda o, i: agent.option_probs(params, o, i),
        "action": lambda o, i: agent.policy(params, o, i).mean(),
        "every action": lambda o, i: agent.every_policy(params, o).mean(),
        "q": lambda o, i: agent.q(params, o, i),
        "every q": lambda o, i: agent.every_q(params, o, i),
    }
    for name, part in parts.items():
        whole, one = part(obs, option), part(obs[2, 1], option[2, 1])
        np.testing.assert_allclose(whole[2, 1], one, rtol=1e-4, atol=1e-5, err_msg=name)
    every = agent.every_policy(params, obs).mean()
    assert every.shape == (T, B, K, A)
    np.testing.assert_allclose(
        jnp.take_along_axis(every, option[..., None, None], axis=2).squeeze(2),
        agent.policy(params, obs, option).mean(),
        rtol=1e-4,
        atol=1e-5,
    )


def test_drawn_options_have_the_probabilities_stated(agent, key, params):
    obs = jnp.broadcast_to(jax.random.normal(key, (O,)), (8000, O))
    memory = jnp.full(8000, 2)
    _, _, record = agent.act(params, obs, memory, key)
    frequencies = np.bincount(agent.option_of(record), minlength=K) / 8000
    stated = agent.option_probs(params, obs[0], memory[0])
    np.testing.assert_allclose(frequencies, stated, atol=0.025)
