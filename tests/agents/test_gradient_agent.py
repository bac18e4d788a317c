"""The optimiser that every agent shares, by hand."""

import jax
import numpy as np
import pytest

from hitmdp_jax.agents import PPO
from hitmdp_jax.agents.base import LearnerState
from tests.programs import compiled

RATE, EPS = 0.1, 0.5  # so large that Adam's first step tells a small gradient from a large one


@compiled
def one_step(agent, params, data):
    """One epoch of one minibatch, whose gradient is the mean of the data."""

    def loss(params, data):
        loss = (params["w"] * data.mean(0)).sum()
        return loss, {"loss": loss}

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
