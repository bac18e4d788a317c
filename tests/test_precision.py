"""Nothing depends on JAX's default of 32 or 64 bits: no type, and no number but by rounding.

Of agents, tests/agents/test_contract.py says so.
"""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax import make_env
from hitmdp_jax.agents import PPO
from hitmdp_jax.envs import list_envs
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.precision import in_32_bits
from hitmdp_jax.runs.policy import Policy
from tests.cli.conftest import command, variables
from tests.probes import QUICK
from tests.programs import types

__all__ = ["command", "variables"]  # fixtures


def in_both(function):
    """Return what a function of no argument returns by default and under x64."""
    found = []
    for enabled in (False, True):
        with jax.enable_x64(enabled):
            found.append(function())
    return found


def test_arrays_of_64_bits_alone_are_changed():
    with jax.enable_x64(True):
        wide = [jnp.zeros(2), jnp.arange(3), jnp.array([2**40], jnp.uint64), jnp.zeros(1, complex)]
        rest = [jnp.zeros(2, jnp.float16), jnp.ones(1, bool), jax.random.key(0), 1.5, None]
        narrow = in_32_bits(wide + rest)
        assert [str(x.dtype) for x in narrow[:4]] == ["float32", "int32", "uint32", "complex64"]
        assert all(x is y for x, y in zip(narrow[4:], rest, strict=True))


# What stands for all: a task of each suite and way to start, and one by MJX, whose fields are
# brought up to date; MJX with RK4 and contacts is slow. Brax computes for itself.
NATIVE = (
    "toy/turkey",
    "ant",
    "reacher",
    "maze/point_umaze",
    "dmc/fish_upright",
    "dmc/reacher_easy",
)
TASKS = [(name, "native") for name in NATIVE]
TASKS += [("dmc/cartpole_balance", "mjx")]
REST = [(name, "native") for name in list_envs() if (name, "native") not in TASKS]
REST += [("hopper", "mjx"), ("brax/ant", "mjx")]  # traced in ten seconds each


@pytest.mark.parametrize(
    ("name", "physics"), [*TASKS, *(pytest.param(*task, marks=pytest.mark.slow) for task in REST)]
)
def test_every_task_has_the_same_types(name, physics):
    def states():
        env = VectorEnv(make_env(name, physics=physics), 2, pool_size=2)
        action = jax.ShapeDtypeStruct((2, env.env.action_size), "float32")
        before = jax.eval_shape(env.reset, jax.random.key(0))
        after, outcome = jax.eval_shape(env.step, before, action)
        assert types(after) == types(before)
        return outcome.replace(next_obs=None) if name.startswith("brax/") else (after, outcome)

    default, wide = in_both(states)
    assert types(wide) == types(default)


# A task of every kind of draw that an episode starts with.
DRAWS = ["hopper", "reacher", "maze/point_umaze", "dmc/cartpole_balance", "dmc/fish_upright",
         "dmc/cheetah_run", "dmc/reacher_easy"]  # fmt: skip


@pytest.mark.parametrize("name", DRAWS)
def test_a_task_starts_and_steps_in_the_same_states(name):
    """Whatever it draws, and whatever type the actions have."""

    def stepped():
        env = make_env(name, physics="native")
        start = jax.jit(env.reset)(jax.random.key(3))
        action = jnp.full(env.action_size, 0.3)  # of JAX's default type
        assert types(jax.eval_shape(env.step, start, action)) == types(start)
        return start.obs, jax.jit(env.step)(start, action).obs

    for default, wide in zip(*in_both(stepped), strict=True):
        np.testing.assert_allclose(wide, default, rtol=1e-4, atol=1e-5)


def test_training_and_evaluation_give_the_same_numbers():
    agent, env = PPO(num_epochs=1, hidden_sizes=(8,)), make_env("toy/turkey")

    def trained():
        sizes = {"num_steps": 256, "num_envs": 8, "rollout_length": 16}
        train = jax.jit(lambda key: hitmdp_jax.train(agent, env, key, **sizes))
        state, metrics = train(jax.random.key(0))
        policy = Policy(agent.bind(state.spec), state.learner.params, state.normalizer)
        returns = run_episodes(policy, env, jax.random.key(1), 4).returns
        return state.learner.params, metrics, returns

    default, wide = in_both(trained)
    assert types(wide) == types(default)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4), wide, default)


@pytest.mark.whole
def test_the_command_line_trains_and_evaluates_under_x64(tmp_path, variables):
    """In a process of its own: what was traced before the setting changed would be used after."""
    algo = [f"algo.{k}={v}" for k, v in QUICK["algo"].items() if k != "name"]
    settings = ("algo=ppo", *algo, "env=invertedpendulum", "physics=native", "total_steps=2048")
    evaluated = ("eval_every=2048", "eval_episodes=2", "report=false", f"run_dir={tmp_path}")
    out = subprocess.run(
        [sys.executable, "-m", "hitmdp_jax", "train", *settings, *evaluated],
        env=os.environ | variables | {"JAX_ENABLE_X64": "1"},
        capture_output=True,
        text=True,
    )
    assert out.returncode == 0, out.stderr
    assert (tmp_path / "evaluations.csv").read_text().count("\n") == 2
