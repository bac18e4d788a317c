import math

import pytest
from dm_control.utils import rewards

from hitmdp_jax.envs.suites.dmc.cheetah import NUM_SETTLED
from tests.envs.suites.dmc.parity import Oracle, assert_initial_states_agree, assert_steps_agree


def backward(physics):
    return rewards.tolerance(
        -physics.speed(),
        bounds=(10.0, math.inf),
        margin=10.0,
        value_at_margin=0.0,
        sigmoid="linear",
    )


TASKS = {
    "dmc/cheetah_run": Oracle("cheetah", "run"),
    "dmc/cheetah_backward": Oracle("cheetah", "run", backward),
}


@pytest.mark.parametrize("name", TASKS)
def test_native_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "native")


@pytest.mark.slow  # compiling takes long; by default, test_reacher stands for the suite in MJX
@pytest.mark.parametrize("name", TASKS)
def test_mjx_steps_as_the_suite(name):
    assert_steps_agree(name, TASKS[name], "mjx", num_steps=1)


def test_initial_states_are_the_suites():
    oracle = TASKS["dmc/cheetah_run"]
    assert_initial_states_agree("dmc/cheetah_run", oracle, num_draws=1000, num_ours=NUM_SETTLED)
