import pytest
from dm_control.utils import rewards

from tests.envs.suites.dmc.parity import Oracle, assert_initial_states_agree, assert_steps_agree


def downleft(physics):
    return rewards.tolerance(-physics.upright(), bounds=(1, 1), margin=1)


TASKS = {
    "dmc/fish_upright": Oracle("fish", "upright"),
    "dmc/fish_downleft": Oracle("fish", "upright", downleft),
}


@pytest.mark.parametrize("name", TASKS)
def test_native_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "native")


@pytest.mark.slow  # compiling takes long; by default, test_reacher stands for the suite in MJX
@pytest.mark.parametrize("name", TASKS)
def test_mjx_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "mjx", num_steps=1)


def test_initial_states_are_the_suites():
    assert_initial_states_agree("dmc/fish_upright", TASKS["dmc/fish_upright"])
