"""How the option baselines draw options, and the values they evaluate a rollout with."""

import jax
import numpy as np
import pytest

from hitmdp_jax.agents import AHP, DAC, PPOC
from hitmdp_jax.learning.options import OptionMemory
from tests.agents.compiled import Compiled
from tests.agents.option_batches import (
    SMALL,
    B,
    K,
    O,
    T,
    normal,
    option_probabilities,
    random_batch,
    random_params,
)

N = 4000


def with_termination(params, logit):
    """Make beta the same everywhere."""
    output = jax.tree.map(np.zeros_like, params["terminations"]["output"])
    output["bias"] += logit
    return params | {"terminations": params["terminations"] | {"output": output}}


@pytest.fixture(params=[DAC, AHP, PPOC])
def agent(request):
    return Compiled(request.param(**SMALL))


def draw(agent, initial, logit, key):
    """Draw N options in one state, with beta the same everywhere."""
    params = with_termination(random_params(agent), logit)
    memory = OptionMemory(np.arange(N) % K, np.full(N, initial))
    obs = np.broadcast_to(normal(np.random.default_rng(1), O), (N, O))
    _, new_memory, _ = agent.act(params, obs, memory, key)
    assert not new_memory.initial.any()
    master = np.exp(agent.heads(params, obs[0]).log_master)
    return new_memory.previous, memory.previous, master


def test_an_option_that_never_terminates_goes_on(agent, key):
    option, previous, _ = draw(agent, False, -50.0, key)
    np.testing.assert_array_equal(option, previous)


def test_an_option_that_always_terminates_leaves_the_choice_to_the_master(agent, key):
    option, _, master = draw(agent, False, 50.0, key)
    np.testing.assert_allclose(np.bincount(option, minlength=K) / N, master, atol=0.03)


def test_the_master_chooses_an_episodes_first_option(agent, key):
    option, _, master = draw(agent, True, -50.0, key)
    np.testing.assert_allclose(np.bincount(option, minlength=K) / N, master, atol=0.03)


def test_values_of_both_augmented_mdps_equal_their_definitions():
    agent, batch = Compiled(DAC(**SMALL)), random_batch()
    params = random_params(agent)
    data, values = agent.targets(params, batch)[0], agent.values(params, batch)
    for t in range(T):
        for b in range(B):
            heads = agent.heads(params, batch.obs[t, b])
            reached = agent.heads(params, batch.next_obs[t, b])
            option, previous = int(batch.record[t, b]), int(batch.memory.previous[t, b])
            here = option_probabilities(heads, previous, batch.memory.initial[t, b])
            there = option_probabilities(reached, option, False)
            ended = batch.terminated[t, b] or batch.truncated[t, b] or t == T - 1
            expected = {
                "value": here @ heads.value,
                "value_next": there @ reached.value,
                "q": heads.value[option],
                "q_next": there @ reached.value
                if ended
                else reached.value[int(batch.record[t + 1, b])],
            }
            for name, value in expected.items():
                np.testing.assert_allclose(getattr(values, name)[t, b], value, rtol=1e-4, atol=1e-5)
            np.testing.assert_allclose(np.exp(data["log_option"][t, b]), here, rtol=1e-4)


def test_hidden_sizes_and_activation_shape_every_body(key):
    agent = Compiled(DAC(**SMALL, activation="relu", num_options=3))
    params = jax.eval_shape(lambda key: agent.init(key, agent.spec), key).params
    assert params["policies"]["body"]["input_0"]["kernel"].shape == (3, O, 8)
    assert params["critic"]["output"]["kernel"].shape == (8, 3)
