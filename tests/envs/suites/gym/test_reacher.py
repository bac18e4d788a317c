import pytest

from tests.envs.suites.gym.parity import assert_initial_states_agree, assert_steps_agree


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_native_steps_as_gymnasium(version):
    assert_steps_agree("reacher", version, "native")


@pytest.mark.slow  # half a minute to compile; by default, test_half_cheetah stands for MJX
@pytest.mark.parametrize("version", ["v4", "v5"])
def test_mjx_steps_as_gymnasium(version):
    assert_steps_agree("reacher", version, "mjx", num_steps=1, tolerance=1e-3)


@pytest.mark.parametrize("version", ["v5"])
def test_keywords_mean_what_they_mean_in_gymnasium(version):
    assert_steps_agree(
        "reacher",
        version,
        "native",
        reward_dist_weight=2.0,
        reward_control_weight=0.3,
    )


def test_initial_states_are_gymnasiums():
    assert_initial_states_agree("reacher", "v5")
