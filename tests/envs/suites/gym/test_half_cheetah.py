import pytest

from tests.envs.suites.gym.parity import assert_initial_states_agree, assert_steps_agree


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_native_steps_as_gymnasium(version):
    assert_steps_agree("halfcheetah", version, "native")


@pytest.mark.parametrize("version", [pytest.param("v4", marks=pytest.mark.slow), "v5"])
def test_mjx_steps_as_gymnasium(version):
    assert_steps_agree("halfcheetah", version, "mjx", num_steps=1, tolerance=1e-3)


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_keywords_mean_what_they_mean_in_gymnasium(version):
    assert_steps_agree(
        "halfcheetah",
        version,
        "native",
        forward_reward_weight=2.0,
        ctrl_cost_weight=0.5,
        exclude_current_positions_from_observation=False,
    )


def test_initial_states_are_gymnasiums():
    assert_initial_states_agree("halfcheetah", "v5", reset_noise_scale=0.2)
