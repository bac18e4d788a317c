import jax
import numpy as np
import pytest

from hitmdp_jax.learning.surrogate import clipped_surrogate
from tests.programs import compiled


@compiled
def surrogate(log_prob, old_log_prob, advantage):
    """The objective, its gradient and the diagnostics."""
    (objective, diagnostics), gradient = jax.value_and_grad(
        lambda x: clipped_surrogate(x, old_log_prob, advantage, 0.2, "action"), has_aux=True
    )(log_prob)
    return objective, gradient, diagnostics


@pytest.mark.parametrize(
    ("ratio", "advantage", "expected"),
    [
        (1.0, 3.0, 3.0),
        (1.1, 1.0, 1.1),  # inside the interval
        (1.5, 1.0, 1.2),  # gain is capped at 1 + eps
        (1.5, -1.0, -1.5),  # loss is not
        (0.5, 1.0, 0.5),  # min(0.5, 0.8)
        (0.5, -1.0, -0.8),  # min(-0.5, -0.8)
    ],
)
def test_surrogate_equals_hand_computed_cases(ratio, advantage, expected):
    objective, _, _ = surrogate(np.log([ratio]), np.zeros(1), np.array([advantage]))
    np.testing.assert_allclose(objective, expected, rtol=1e-6)


def test_gradient_at_the_old_policy_is_the_policy_gradient():
    advantage = np.array([1.0, -2.0, 3.0])
    old = np.array([-1.0, -0.5, -2.0])
    _, gradient, _ = surrogate(old, old, advantage)
    np.testing.assert_allclose(gradient, advantage / 3)


def test_clipped_samples_give_no_gradient():
    _, gradient, _ = surrogate(np.array([1.0, 0.0]), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(gradient, [0.0, 0.5])


def test_diagnostics_equal_their_definitions():
    _, _, diagnostics = surrogate(np.log([1.5, 1.0]), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(diagnostics["action_clip_fraction"], 0.5)
    np.testing.assert_allclose(diagnostics["action_kl"], (0.5 - np.log(1.5)) / 2, rtol=1e-5)
