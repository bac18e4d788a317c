"""The optimiser that every agent shares, by hand."""

import jax
import numpy as np
import pytest

from hitmdp_jax.agents import AGENTS, PPO
from hitmdp_jax.agents.base import LearnerState
from tests.agents.compiled import Compiled
from tests.agents.option_batches import SMALL, random_batch
from tests.programs import compiled

RATE, EPS = 0.1, 0.5  # so large that Adam's first step tells a small gradient from a large one


@compiled
def one_step(agent, params, data):
    """One epoch of one minibatch, whose gradient is the mean of the data."""

    def loss(params, data):
        return (params["w"] * data.mean(0)).sum(), {}

    state = LearnerState(params, agent.optimizer().init(params))
    return agent.optimize(loss, state, data, jax.random.key(0))


@pytest.mark.parametrize("max_grad_norm", [1.0, 100.0, float("inf")])
def test_a_step_is_adams_behind_the_gradient_norm_clip(max_grad_norm):
    agent = PPO(
        learning_rate=RATE,
        adam_eps=EPS,
        max_grad_norm=max_grad_norm,
        num_epochs=1,
        minibatch_size=6,
    )
    params = {"w": np.array([1.0, -2.0], np.float32)}
    gradient = np.array([3.0, -4.0])  # of norm 5
    data = gradient + np.array([-1.0, 0.0, 1.0] * 2).reshape(3, 2, 1)  # [T, B, 2]
    state, metrics = one_step(agent, params, data)
    gradient *= min(1.0, max_grad_norm / 5)
    # Adam's first moments, corrected, are the gradient and its square.
    expected = params["w"] - RATE * gradient / (np.abs(gradient) + EPS)
    np.testing.assert_allclose(state.params["w"], expected, rtol=1e-5)
    np.testing.assert_allclose(metrics["loss"], 3.0 + 8.0, rtol=1e-5)


@pytest.mark.parametrize("name", ["ppo", "mopg", "dac", "ahp", "ppoc", "moc"])
def test_an_update_that_moves_a_policy_too_far_lowers_the_rate_of_the_next(name):
    """The KL of the policy that moved most counts; the next update is one of the lower rate."""
    agent = Compiled(
        AGENTS[name](learning_rate=0.1, target_kl=0.02, minibatch_size=5, num_epochs=2, **SMALL)
    )
    state = agent.init(jax.random.key(0), agent.spec)
    batch, key = random_batch(), jax.random.key(1)
    if name == "mopg":
        batch = batch.replace(memory=batch.memory.previous)
    if name == "ahp":
        batch = batch.replace(record=(batch.record, batch.record != batch.memory.previous))
    first, metrics = agent.update(state, batch, key)
    kl = max(float(x) for metric, x in metrics.items() if metric.endswith("_kl"))
    assert kl > agent.target_kl
    assert first.rate_share == pytest.approx(max((agent.target_kl / kl) ** 0.2, 0.5), rel=1e-4)
    assert metrics["learning_rate"] == pytest.approx(0.1)
    second, metrics = agent.update(first, batch, key)
    assert metrics["learning_rate"] == pytest.approx(0.1 * first.rate_share)
    lower = agent.replace(learning_rate=0.1 * first.rate_share)
    expected, _ = lower.update(first.replace(rate_share=np.ones((), np.float32)), batch, key)
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-4, atol=1e-5),
        second.params,
        expected.params,
    )


def test_a_kl_without_limit_leaves_the_rate_alone():
    agent = Compiled(
        PPO(learning_rate=0.1, target_kl=float("inf"), minibatch_size=5, num_epochs=2, **SMALL)
    )
    state, _ = agent.update(
        agent.init(jax.random.key(0), agent.spec), random_batch(), jax.random.key(1)
    )
    assert state.rate_share == 1.0
