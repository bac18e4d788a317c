"""Every task steps and starts as dm_control's, or as one of its with the reward stated here."""

import math

import numpy as np
import pytest
from dm_control.utils import rewards

from hitmdp_jax import make_env
from hitmdp_jax.envs.suites.dmc.cheetah import NUM_SETTLED
from tests.envs.suites.dmc.oracle import SuiteTask
from tests.envs.suites.gym.trained_states import trained_states
from tests.envs.suites.parity import (
    assert_initial_states_agree,
    assert_steps_agree,
    random_states,
)


def run_backward(physics):
    return rewards.tolerance(
        -physics.speed(),
        bounds=(10.0, math.inf),
        margin=10.0,
        value_at_margin=0.0,
        sigmoid="linear",
    )


def downleft(physics):
    return rewards.tolerance(-physics.upright(), bounds=(1, 1), margin=1)


def stand(physics, height):
    standing = rewards.tolerance(
        physics.torso_height(), bounds=(height, math.inf), margin=height / 2
    )
    return (3 * standing + (1 + physics.torso_upright()) / 2) / 4


def squat(physics):
    return stand(physics, 0.6)


def walk_backward(physics):
    move = rewards.tolerance(
        -physics.horizontal_velocity(),
        bounds=(1.0, math.inf),
        margin=0.5,
        value_at_margin=0.5,
        sigmoid="linear",
    )
    return stand(physics, 1.2) * (5 * move + 1) / 6


TASKS = {  # arguments of `SuiteTask`
    "dmc/cartpole_balance": ("cartpole", "balance"),
    "dmc/cartpole_balance_sparse": ("cartpole", "balance_sparse"),
    "dmc/cheetah_run": ("cheetah", "run"),
    "dmc/cheetah_backward": ("cheetah", "run", run_backward),
    "dmc/fish_upright": ("fish", "upright"),
    "dmc/fish_downleft": ("fish", "upright", downleft),
    "dmc/reacher_easy": ("reacher", "easy", None, "target"),
    "dmc/reacher_hard": ("reacher", "hard", None, "target"),
    "dmc/walker_walk": ("walker", "walk"),
    "dmc/walker_squat": ("walker", "stand", squat),
    "dmc/walker_stand": ("walker", "stand"),
    "dmc/walker_backward": ("walker", "walk", walk_backward),
}
DOMAINS = {arguments[0]: name for name, arguments in reversed(TASKS.items())}  # a task of each
MJX_FOR_ALL = "dmc/reacher_easy"  # stands for all; each program takes long to compile


def states_of(oracle):
    """Return the states to step from: random trajectories', and for reachers near the target."""
    qpos, qvel = random_states(oracle, stride=10)
    if oracle.domain == "reacher":
        rng, physics = np.random.default_rng(2), oracle.physics
        for row in range(len(qpos)):  # its target is about to touch the finger, or just not
            oracle.set_state(qpos[row], qvel[row])
            physics.forward()
            reach = physics.named.model.geom_size[["target", "finger"], 0].sum()
            finger = physics.named.data.geom_xpos["finger", :2]
            qpos[row, 2:] = finger + rng.uniform(-1.2 * reach, 1.2 * reach, 2)
    return qpos, qvel


def assert_agree(name, physics, **how):
    """From the states above and from those of a trained policy."""
    oracle = SuiteTask(*TASKS[name])
    states = zip(states_of(oracle), trained_states(name), strict=True)
    qpos, qvel = (np.concatenate(parts) for parts in states)
    assert len(qpos) >= 200
    env = make_env(name, physics=physics)
    desired, actual = assert_steps_agree(env, oracle, (qpos, qvel), **how)
    assert desired.reward.std() > 0, "these states do not tell one reward from another"
    assert not actual.terminated.any()


@pytest.mark.parametrize("name", TASKS)
def test_native_steps_as_the_suite(name):
    assert_agree(name, "native")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.whole if n == MJX_FOR_ALL else pytest.mark.slow)
        for n in TASKS
    ],
)
def test_mjx_steps_as_the_suite(name):
    assert_agree(name, "mjx", num_steps=1)


@pytest.mark.parametrize("domain", DOMAINS)
def test_initial_states_are_the_suites(domain):
    """Mean, std and ends of 2,000 episodes; falls of the cheetah take longer."""
    name = DOMAINS[domain]
    number = {"num_draws": 1000, "num_ours": NUM_SETTLED} if domain == "cheetah" else {}
    env, oracle = make_env(name, physics="native"), SuiteTask(*TASKS[name])
    assert_initial_states_agree(env, oracle, **({"num_draws": 2000} | number))


@pytest.mark.parametrize(
    ("name", "part", "places"),
    [("cartpole_balance", "place", [0]), ("reacher_easy", "goal", [2, 3])],
)
def test_tasks_name_the_parts_of_what_they_show(name, part, places):
    seen = make_env(f"dmc/{name}", physics="native").spec.observation
    np.testing.assert_array_equal(seen.entries_of([part]), places)
    assert {part, "body"} == {known for known, _ in seen.parts}
