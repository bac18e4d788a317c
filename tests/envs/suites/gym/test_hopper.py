import pytest

from tests.envs.suites.gym.parity import assert_initial_states_agree, assert_steps_agree


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_native_steps_as_gymnasium(version):
    assert_steps_agree("hopper", version, "native")


@pytest.mark.slow  # half a minute to compile; by default, test_half_cheetah stands for MJX
@pytest.mark.parametrize("version", ["v4", "v5"])
def test_mjx_steps_as_gymnasium(version):
    assert_steps_agree("hopper", version, "mjx", num_steps=1, tolerance=1e-3)


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_keywords_mean_what_they_mean_in_gymnasium(version):
    assert_steps_agree(
        "hopper",
        version,
        "native",
        forward_reward_weight=2.0,
        ctrl_cost_weight=0.5,
        healthy_reward=0.3,
        terminate_when_unhealthy=False,
        healthy_state_range=(-3.0, 2.0),
        healthy_z_range=(1.1, 1.24),
        healthy_angle_range=(-0.05, 0.1),
        exclude_current_positions_from_observation=False,
    )


def test_initial_states_are_gymnasiums():
    assert_initial_states_agree("hopper", "v5", reset_noise_scale=0.2)
