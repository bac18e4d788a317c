import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.learning.surrogate import clipped_surrogate


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
    log_ratio, one = jnp.log(jnp.array([ratio])), jnp.zeros(1)
    objective, _ = clipped_surrogate(log_ratio, one, jnp.array([advantage]), 0.2, "action")
    np.testing.assert_allclose(objective, expected, rtol=1e-6)


def test_gradient_at_the_old_policy_is_the_policy_gradient():
    advantage = jnp.array([1.0, -2.0, 3.0])
    old = jnp.array([-1.0, -0.5, -2.0])
    gradient = jax.grad(lambda x: clipped_surrogate(x, old, advantage, 0.2, "action")[0])(old)
    np.testing.assert_allclose(gradient, advantage / 3)


def test_clipped_samples_give_no_gradient():
    gradient = jax.grad(
        lambda x: clipped_surrogate(x, jnp.zeros(2), jnp.ones(2), 0.2, "action")[0]
    )(jnp.array([1.0, 0.0]))
    np.testing.assert_allclose(gradient, [0.0, 0.5])


def test_diagnostics_equal_their_definitions():
    log_prob = jnp.log(jnp.array([1.5, 1.0]))
    _, diagnostics = clipped_surrogate(log_prob, jnp.zeros(2), jnp.ones(2), 0.2, "action")
    np.testing.assert_allclose(diagnostics["action_clip_fraction"], 0.5)
    np.testing.assert_allclose(diagnostics["action_kl"], (0.5 - np.log(1.5)) / 2, rtol=1e-5)
