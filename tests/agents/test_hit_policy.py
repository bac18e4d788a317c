"""The policy of HiT-MDPs: its memory, its options and the shapes it takes."""

import numpy as np
import pytest

from hitmdp_jax.agents import MOPG
from tests.agents.compiled import Compiled
from tests.agents.option_batches import SMALL, A, B, K, O, T, normal, random_params
from tests.programs import compiled

AGENT = MOPG(**SMALL)


def test_initial_options_are_uniform(agent, key):
    options = agent.initial_memory(key, (4000,))
    np.testing.assert_allclose(np.bincount(options) / 4000, 0.25, atol=0.03)


def test_memory_is_the_option_taken(agent, key, params):
    memory = np.zeros(64, np.int32)
    _, new_memory, record = agent.act(params, np.ones((64, O)), memory, key)
    np.testing.assert_array_equal(new_memory, record)


def test_the_first_options_of_the_paper_are_option_zero(key):
    assert not MOPG(initial_option="first").initial_memory(key, (4,)).any()


def test_memory_of_order_three_holds_the_last_three_options():
    agent = MOPG(value_order=3)
    memory = 0
    for option in (1, 2, 3):
        memory = agent.remember(memory, option)
    assert int(memory) == 3 + 4 * 2 + 16 * 1
    assert int(agent.previous_option(memory)) == 3
    assert int(agent.remember(memory, 0)) == 0 + 4 * 3 + 16 * 2


def test_values_of_order_two_depend_on_both_options():
    agent = Compiled(MOPG(value_order=2, **SMALL))
    params, obs = random_params(agent), normal(np.random.default_rng(1), B, O)
    options, memory = np.array([0, 1, 2]), np.array([3, 2, 1])
    every = agent.every_q(params, obs, memory)
    for b, (option, previous) in enumerate(zip(options, memory, strict=True)):
        # Q_O[s, o_t, o_{t-1}]
        one = agent.q(params, obs[b][None], (option + K * previous)[None])
        np.testing.assert_allclose(every[b, option], one[0], rtol=1e-5)
        without = agent.q(params, obs[b][None], option[None])
        assert not np.allclose(every[b, option], without)


@pytest.mark.parametrize("form", ["similarity", "printed"])
def test_parts_take_any_batch_shape(form):
    agent, random = MOPG(master_policy=form, **SMALL), np.random.default_rng(1)
    params, obs, option = (
        random_params(agent),
        normal(random, T, B, O),
        random.integers(K, size=(T, B)),
    )

    @compiled
    def parts(params, obs, option):
        return {
            "option": agent.option_probs(params, obs, option),
            "action": agent.policy(params, obs, option).mean(),
            "every action": agent.every_policy(params, obs).mean(),
            "q": agent.q(params, obs, option),
            "every q": agent.every_q(params, obs, option),
        }

    whole, one = parts(params, obs, option), parts(params, obs[2, 1], option[2, 1])
    for name in whole:
        np.testing.assert_allclose(whole[name][2, 1], one[name], rtol=1e-4, atol=1e-5, err_msg=name)
    every = whole["every action"]
    assert every.shape == (T, B, K, A)
    np.testing.assert_allclose(
        np.take_along_axis(every, option[..., None, None], axis=2).squeeze(2),
        whole["action"],
        rtol=1e-4,
        atol=1e-5,
    )


def test_drawn_options_have_the_probabilities_stated(agent, key, params):
    obs = np.broadcast_to(normal(np.random.default_rng(1), O), (8000, O))
    memory = np.full(8000, 2)
    _, _, record = agent.act(params, obs, memory, key)
    frequencies = np.bincount(agent.option_of(record), minlength=K) / 8000
    stated = agent.option_probs(params, obs[0], memory[0])
    np.testing.assert_allclose(frequencies, stated, atol=0.025)
