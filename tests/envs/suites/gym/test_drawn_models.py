"""Cheetahs of other friction and other masses in each episode, against MuJoCo's own of those."""

import copy

import jax
import mujoco
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.agents import PPO
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import run_in_gymnasium
from tests.probes import spec_of_sizes, untrained_policy

RANGES = {"friction_range": (0.5, 2.0), "mass_range": (0.5, 2.0)}
DRAWN = {"geom_friction", "body_mass", "body_inertia"}
EPISODES, STEPS = 6, 3
TOLERANCE = {"native": 1e-6, "mjx": 1e-5}  # of the first without `mj_setConst`: 3e-3


def drawn_model(model, fields, episode):
    """Return a copy of a model with an episode's fields and all that MuJoCo derives from them."""
    own = copy.copy(model)
    for name in DRAWN:
        getattr(own, name)[:] = fields[name][episode]
    mujoco.mj_setConst(own, mujoco.MjData(own))
    return own


@pytest.mark.parametrize("engine", ["native", pytest.param("mjx", marks=pytest.mark.whole)])
def test_an_episode_moves_as_the_model_that_it_drew(engine):
    env = make_env("halfcheetah", physics=engine, **RANGES)
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), EPISODES))
    start = jax.device_get(states.pipeline_state)
    controls = np.random.default_rng(0).uniform(-1, 1, (STEPS, EPISODES, 6)).astype(np.float32)
    step = jax.jit(jax.vmap(env.step))
    for control in controls:
        states = step(states, control)
    ended = jax.device_get(states.pipeline_state)
    for episode in range(EPISODES):
        model = drawn_model(env.model, start.drawn, episode)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = start.qpos[episode], start.qvel[episode]
        for control in controls[:, episode]:
            data.ctrl[:] = control
            mujoco.mj_step(model, data, nstep=env.physics.frame_skip)
        np.testing.assert_allclose(ended.qpos[episode], data.qpos, atol=TOLERANCE[engine])
        for name in DRAWN:
            np.testing.assert_array_equal(ended.drawn[name], start.drawn[name])


def test_factors_fill_their_ranges_and_each_episode_has_its_own():
    env = make_env("halfcheetah", physics="native", **RANGES)
    drawn = jax.jit(jax.vmap(env.sample_model))(jax.random.split(jax.random.key(0), 2000))
    friction = drawn["geom_friction"] / env.model.geom_friction
    np.testing.assert_array_equal(friction[..., 1:], 1.0)
    masses = (drawn["body_mass"] / env.model.body_mass)[:, 1:]  # the world has none
    for factors in (
        friction[..., 0],
        masses,
        (drawn["body_inertia"] / env.model.body_inertia)[:, 1:, 0],
    ):
        assert np.ptp(factors, axis=1).max() < 1e-6
        first = np.asarray(factors[:, 0])
        assert 0.5 <= first.min() < 0.51 < 1.99 < first.max() <= 2.0
        assert first.mean() == pytest.approx(1.25, abs=0.04)
    assert abs(np.corrcoef(friction[:, 0, 0], masses[:, 0])[0, 1]) < 0.1


def test_a_new_episode_has_a_new_model():
    """Of one environment that restarts, as training does it; MuJoCo C steps with the new one."""
    env = VectorEnv(make_env("halfcheetah", physics="native", **RANGES), 2, 4, 3, stagger=False)
    state = jax.jit(env.reset)(jax.random.key(0))
    step = jax.jit(env.step)
    friction = []
    for _ in range(7):
        friction.append(np.asarray(state.env.pipeline_state.drawn["geom_friction"][:, 0, 0]))
        state, _ = step(state, np.zeros((2, 6), np.float32))
    of_episodes = np.stack([friction[0], friction[3], friction[6]])
    assert len(np.unique(of_episodes)) == 6
    np.testing.assert_array_equal(friction[2], friction[0])
    np.testing.assert_array_equal(friction[5], friction[3])


def test_without_ranges_nothing_is_drawn_and_nothing_is_kept():
    usual = make_env("halfcheetah", physics="native")
    assert usual.sample_model(jax.random.key(0)) == {}
    assert jax.eval_shape(usual.reset, jax.random.key(0)).pipeline_state.drawn == {}
    assert spec_of(usual) == spec_of(make_env("halfcheetah", physics="native", **RANGES))


def test_factors_that_are_not_above_zero_are_refused():
    with pytest.raises(UsageError, match=r"mass_range = \[0, 1\] must be two numbers above 0"):
        make_env("halfcheetah", physics="native", mass_range=[0, 1])
    with pytest.raises(UsageError, match=r"friction_range = .* the lower first"):
        make_env("halfcheetah", physics="native", friction_range=(2.0, 1.0))


def test_gymnasium_knows_of_no_drawn_models(key):
    policy = untrained_policy(PPO(hidden_sizes=(2,), spec=spec_of_sizes(17, 6)), key)
    with pytest.raises(UsageError, match="Gymnasium has no mass_range"):
        run_in_gymnasium(policy, {"name": "halfcheetah", "mass_range": [0.5, 1.0]}, key, 1)
