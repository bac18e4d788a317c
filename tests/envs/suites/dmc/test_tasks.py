"""Every task steps and starts as dm_control's, or as one of its with the reward stated here."""

import math

import numpy as np
import pytest
from dm_control.utils import rewards

from hitmdp_jax.envs.suites.dmc.cheetah import NUM_SETTLED
from tests.envs.suites.dmc.parity import (
    Oracle,
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


TASKS = {
    "dmc/cartpole_balance": Oracle("cartpole", "balance"),
    "dmc/cartpole_balance_sparse": Oracle("cartpole", "balance_sparse"),
    "dmc/cheetah_run": Oracle("cheetah", "run"),
    "dmc/cheetah_backward": Oracle("cheetah", "run", run_backward),
    "dmc/fish_upright": Oracle("fish", "upright"),
    "dmc/fish_downleft": Oracle("fish", "upright", downleft),
    "dmc/reacher_easy": Oracle("reacher", "easy", drawn_geom="target"),
    "dmc/reacher_hard": Oracle("reacher", "hard", drawn_geom="target"),
    "dmc/walker_walk": Oracle("walker", "walk"),
    "dmc/walker_squat": Oracle("walker", "stand", squat),
    "dmc/walker_stand": Oracle("walker", "stand"),
    "dmc/walker_backward": Oracle("walker", "walk", walk_backward),
}
DOMAINS = {oracle.domain: name for name, oracle in reversed(TASKS.items())}  # a task of each
MJX_BY_DEFAULT = "dmc/reacher_easy"  # stands for all; each program takes long to compile


def states_of(name):
    """Return the states to step from: random trajectories', and for reachers near the target."""
    oracle = TASKS[name]
    qpos, qvel = random_states(oracle)
    if oracle.domain != "reacher":
        return qpos, qvel
    env, rng = oracle.load(), np.random.default_rng(2)
    env.reset()
    for row in range(len(qpos)):  # its target is about to touch the finger, or just not
        oracle.set_state(env, qpos[row], qvel[row])
        env.physics.forward()
        reach = env.physics.named.model.geom_size[["target", "finger"], 0].sum()
        finger = env.physics.named.data.geom_xpos["finger", :2]
        qpos[row, 2:] = finger + rng.uniform(-1.2 * reach, 1.2 * reach, 2)
    return qpos, qvel


@pytest.mark.parametrize("name", TASKS)
def test_native_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "native", states_of(name))


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n == MJX_BY_DEFAULT else pytest.mark.slow) for n in TASKS],
)
def test_mjx_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "mjx", states_of(name), num_steps=1)


@pytest.mark.parametrize("domain", DOMAINS)
def test_initial_states_are_the_suites(domain):
    name = DOMAINS[domain]
    settled = {"num_draws": 1000, "num_ours": NUM_SETTLED} if domain == "cheetah" else {}
    assert_initial_states_agree(name, TASKS[name], **settled)
