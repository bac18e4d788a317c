import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.learning.value_scale import RATE, SMALLEST, decay, rescale
from hitmdp_jax.networks import Critic


@pytest.fixture(scope="module")
def case():
    obs = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    critic = jax.jit(Critic((8, 8)).init)(jax.random.key(0), obs)["params"]
    return obs, critic


rescaled = jax.jit(rescale)


@jax.jit
def values(critic, obs):
    return Critic((8, 8)).apply({"params": critic}, obs)


def targets(mean, std):
    return mean + std * np.random.default_rng(1).normal(size=(64, 32)).astype(np.float32)


@pytest.mark.parametrize(("mean", "std"), [(0.0, 1.0), (-300.0, 20.0), (5000.0, 3000.0)])
def test_rescaling_changes_no_value_and_comes_to_the_targets_moments(case, mean, std):
    obs, critic = case
    before, target = values(critic, obs), targets(mean, std)
    for _ in range(200):
        critic = rescaled(critic, target)
    np.testing.assert_allclose(values(critic, obs), before, atol=1e-3 * max(1.0, abs(mean)) / 10)
    np.testing.assert_allclose(critic["shift"], target.mean(), rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(critic["scale"], target.std(), rtol=2e-2)


@pytest.mark.parametrize(("mean", "std"), [(1e4, 1.0), (-3e4, 0.5), (0.0, 1e-3), (1e6, 30.0)])
def test_moments_equal_those_of_float64(case, mean, std):
    """Of targets far from zero, too, whose square leaves float32 no digit for their spread."""
    critic, target = case[1], targets(mean, std)
    shift, square = 0.0, 1.0
    for _ in range(300):
        critic = rescaled(critic, target)
        shift += RATE * (target.mean(dtype=float) - shift)
        square += RATE * (np.square(target, dtype=float).mean() - square)
    np.testing.assert_allclose(critic["shift"], shift, rtol=1e-5)
    scale = np.sqrt(max(square - shift**2, SMALLEST**2))
    np.testing.assert_allclose(critic["scale"], scale, rtol=1e-3)


def test_constant_targets_leave_a_finite_scale(case):
    critic = case[1]
    for _ in range(500):
        critic = rescaled(critic, jnp.zeros(64))
    assert critic["scale"] == pytest.approx(SMALLEST)
    assert jnp.isfinite(values(critic, case[0])).all()


def test_no_gradient_reaches_shift_and_scale(case):
    obs, critic = case
    grads = jax.jit(jax.grad(lambda c: jnp.square(values(c, obs) - 7.0).mean()))(critic)
    assert grads["shift"] == grads["scale"] == 0.0
    assert jnp.abs(grads["value"]["kernel"]).max() > 0.0


def test_the_gradient_in_the_critics_units_does_not_depend_on_the_rewards_unit(case):
    """Targets a thousand times as large, the critic scaled to them: the same gradient."""
    obs, critic = case

    @jax.jit
    def gradient(critic, target):
        def loss(critic):
            return jnp.square((values(critic, obs) - target) / critic["scale"]).mean()

        return jax.grad(loss)(critic)["body"]

    target = targets(0.0, 1.0).reshape(-1)[:50]
    small = critic | {"scale": jnp.ones(()), "shift": jnp.zeros(())}
    large = critic | {"scale": 1000 * jnp.ones(()), "shift": jnp.zeros(())}
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6),
        gradient(small, target),
        gradient(large, 1000 * target),
    )


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_values_decay_towards_the_targets_mean(case, share):
    obs, critic = case
    critic = critic | {"shift": jnp.asarray(-5.0), "scale": jnp.asarray(3.0)}
    before, after = values(critic, obs), values(decay(critic, share), obs)
    np.testing.assert_allclose(after + 5.0, (1.0 - share) * (before + 5.0), rtol=1e-4, atol=1e-5)
