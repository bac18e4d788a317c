"""Every algorithm on a task of each suite of another library: one iteration, traced."""

import functools

import jax
import jax.numpy as jnp
import pytest
from brax.envs.base import Wrapper

import hitmdp_jax
from hitmdp_jax.agents import AGENTS
from hitmdp_jax.envs.spec import Discrete, spec_of
from hitmdp_jax.errors import UsageError

OTHERS = (
    "gymnax/Breakout-MinAtar",
    "gymnax/Pendulum-v1",
    "xminigrid/MiniGrid-DoorKey-5x5",
    "craftax/Craftax-Classic-Symbolic-v1",
    "playground/CartpoleBalance",
)
TASKS = ("gymnax/CartPole-v1", *(pytest.param(x, marks=pytest.mark.slow) for x in OTHERS))
SIZES = {"num_envs": 4, "rollout_length": 32, "num_steps": 128}


class TracedOnce(Wrapper):
    """Keeps the traces of a task, so that the next algorithm does not trace it anew."""

    def __init__(self, env):
        super().__init__(env)
        self.reset, self.step = jax.jit(env.reset), jax.jit(env.step)


@functools.cache
def task(name):
    return TracedOnce(hitmdp_jax.make_env(name))


@pytest.mark.parametrize("algorithm", AGENTS)
@pytest.mark.parametrize("name", TASKS)
def test_an_iteration_keeps_the_state_and_reports(name, algorithm):
    """A state that comes out in the shapes it came in with can be trained on for ever.

    SAC's policy draws numbers: tasks of choices are refused.
    """
    if algorithm in ("sac", "hit_sac") and isinstance(spec_of(task(name)).action, Discrete):
        with pytest.raises(UsageError, match="needs actions that are numbers, and here an action"):
            hitmdp_jax.make_train(AGENTS[algorithm](), task(name), **SIZES)
        return
    init, step = hitmdp_jax.make_train(AGENTS[algorithm](), task(name), **SIZES)
    before = jax.eval_shape(init, jax.random.key(0))
    after, metrics = jax.eval_shape(step, before)
    shapes = functools.partial(jax.tree.map, lambda x: (x.shape, x.dtype))
    assert shapes(after) == shapes(before)
    assert {"episode_return", "episodes", "diverged"} <= set(metrics)


@pytest.mark.parametrize("algorithm", ["ppo", "mopg"])
def test_an_iteration_on_cartpole_is_finite(algorithm):
    agent = AGENTS[algorithm](hidden_sizes=(8,))
    init, step = hitmdp_jax.make_train(agent, task("gymnax/CartPole-v1"), **SIZES)
    _, metrics = jax.jit(lambda key: step(init(key)))(jax.random.key(0))
    assert jnp.isfinite(metrics["loss"]).all()
    assert 8 < float(metrics["episode_return"]) < 40  # of random play, about 22
