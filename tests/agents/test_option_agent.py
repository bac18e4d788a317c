"""How the option baselines draw options, and the values they evaluate a rollout with."""

import jax
import numpy as np
import pytest

from hitmdp_jax.agents import AHP, DAC, MOC, PPOC
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


class TestACriticInUnitsOfItsOwn:
    """`normalize_values`, which our MOPG and PPO have by default and these do not."""

    @pytest.fixture(params=[DAC, AHP, PPOC, MOC])
    def agent(self, request):
        return Compiled(request.param(normalize_values=True, value_decay=0.0, **SMALL))

    @pytest.fixture
    def batch(self, agent):
        batch = random_batch()
        stopped = batch.record % 2 == 0
        return batch.replace(record=(batch.record, stopped)) if agent.num_values > K else batch

    def test_it_takes_the_units_of_its_targets_and_no_value_changes(self, agent, key):
        state, obs = agent.init(key, agent.spec), normal(np.random.default_rng(1), T, O)
        target = 1000.0 + 100.0 * normal(np.random.default_rng(2), T, B)
        changed = agent.rescaled(state, target)
        critic = changed.params["critic"]
        assert critic["shift"] == pytest.approx(0.1 * target.mean(), rel=1e-4)
        assert critic["scale"] > 10.0
        np.testing.assert_allclose(
            agent.heads(changed.params, obs).value, agent.heads(state.params, obs).value, atol=1e-3
        )

    def test_its_error_counts_in_these_units(self, agent, batch):
        """Under the scale 3, with the same values, a ninth of the squared error is in the loss."""
        params = random_params(agent)
        critic = params["critic"] | {"scale": np.float32(1.0)}
        last = jax.tree.map(lambda x: x / 3.0, critic["value"])
        wide = critic | {"scale": np.float32(3.0), "value": last}
        data = jax.tree.map(
            lambda x: x.reshape(-1, *x.shape[2:]),
            agent.targets(params | {"critic": critic}, batch)[0],
        )
        losses = (
            (agent.high_loss, agent.low_loss) if isinstance(agent.agent, DAC) else (agent.loss,)
        )
        for loss in losses:
            one, metrics = loss(params | {"critic": critic}, data)
            three, _ = loss(params | {"critic": wide}, data)
            error = metrics["value_loss"] if "value_loss" in metrics else metrics["q_loss"]
            np.testing.assert_allclose(one - three, error * 8 / 9, rtol=1e-3)
