import runpy
from pathlib import Path

import jax
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import MOPG
from hitmdp_jax.errors import UsageError

FILE = Path(__file__).parents[2] / "examples" / "own_task.py"
NAME = f"{FILE}:Pendulum"


def make(**keywords):
    return hitmdp_jax.make_env(NAME, **keywords)


def test_both_engines_take_the_same_step():
    states = []
    for physics in ("mjx", "native"):
        env = make(physics=physics)
        assert env.backend == physics
        assert (env.observation_size, env.action_size, env.episode_length) == (3, 1, 200)
        state = env.reset_to(np.array([1.0]), np.array([0.5]))
        states.append(jax.jit(env.step)(state, np.array([0.7])))
    mjx, native = states
    np.testing.assert_allclose(mjx.obs, native.obs, atol=1e-5)
    np.testing.assert_allclose(mjx.reward, native.reward, atol=1e-5)


def test_a_keyword_reaches_the_task_and_is_checked_by_its_default():
    env = make(physics="native", torque_cost_weight=2)
    state = env.step(env.reset(jax.random.key(0)), np.array([0.5]))
    assert state.metrics["reward_torque"] == -0.5  # 2 * 0.5^2
    with pytest.raises(UsageError, match=r"torque_cost_weight = abc must be a number\."):
        make(torque_cost_weight="abc")
    with pytest.raises(UsageError, match=r"'torqe_cost'; did you mean 'torque_cost_weight'\?"):
        make(torqe_cost=1.0)


@pytest.mark.parametrize("physics", [pytest.param("mjx", marks=pytest.mark.slow), "native"])
def test_it_trains(physics):
    sizes = {"num_steps": 64, "num_envs": 2, "rollout_length": 16}  # two iterations
    agent = MOPG(hidden_sizes=(8,), num_epochs=1, minibatch_size=32)
    train = jax.jit(lambda key: hitmdp_jax.train(agent, make(physics=physics), key, **sizes))
    state, metrics = train(jax.random.key(0))
    assert int(state.iteration) == 2
    assert np.isfinite(metrics["reward_height"]).all()


def test_it_runs_as_a_script(monkeypatch, capsys):
    monkeypatch.setattr("hitmdp_jax.envs.registry._registered", {})
    runpy.run_path(str(FILE), run_name="__main__")
    assert capsys.readouterr().out.startswith("[")


def test_it_stays_short():
    assert len(FILE.read_text().splitlines()) < 60
