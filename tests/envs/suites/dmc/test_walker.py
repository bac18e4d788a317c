import math

import pytest
from dm_control.utils import rewards

from tests.envs.suites.dmc.parity import Oracle, assert_initial_states_agree, assert_steps_agree


def stand(physics, height):
    standing = rewards.tolerance(
        physics.torso_height(), bounds=(height, math.inf), margin=height / 2
    )
    return (3 * standing + (1 + physics.torso_upright()) / 2) / 4


def squat(physics):
    return stand(physics, 0.6)


def backward(physics):
    move = rewards.tolerance(
        -physics.horizontal_velocity(),
        bounds=(1.0, math.inf),
        margin=0.5,
        value_at_margin=0.5,
        sigmoid="linear",
    )
    return stand(physics, 1.2) * (5 * move + 1) / 6


TASKS = {
    "dmc/walker_walk": Oracle("walker", "walk"),
    "dmc/walker_squat": Oracle("walker", "stand", squat),
    "dmc/walker_stand": Oracle("walker", "stand"),
    "dmc/walker_backward": Oracle("walker", "walk", backward),
}


@pytest.mark.parametrize("name", TASKS)
def test_native_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "native")


@pytest.mark.slow  # compiling takes long; by default, test_reacher stands for the suite in MJX
@pytest.mark.parametrize("name", TASKS)
def test_mjx_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "mjx", num_steps=1)


def test_initial_states_are_the_suites():
    assert_initial_states_agree("dmc/walker_walk", TASKS["dmc/walker_walk"])
