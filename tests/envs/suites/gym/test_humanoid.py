import pytest

from tests.envs.suites.gym.parity import assert_initial_states_agree, assert_steps_agree


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_native_steps_as_gymnasium(version):
    assert_steps_agree("humanoid", version, "native")


@pytest.mark.slow
@pytest.mark.timeout(1800)  # compiling takes minutes
def test_mjx_steps_as_gymnasium_with_newton():
    assert_steps_agree("humanoid", "v5", "mjx", num_steps=1, tolerance=2e-3, share=0.9)


@pytest.mark.parametrize("version", ["v5"])
def test_keywords_mean_what_they_mean_in_gymnasium(version):
    assert_steps_agree(
        "humanoid",
        version,
        "native",
        forward_reward_weight=0.5,
        healthy_reward=0.3,
        terminate_when_unhealthy=False,
        healthy_z_range=(1.2, 1.4),
        contact_cost_weight=1e-3,
        contact_cost_range=(0.1, 5.0),
        ctrl_cost_weight=0.2,
        exclude_current_positions_from_observation=False,
        include_cinert_in_observation=False,
        include_qfrc_actuator_in_observation=False,
    )


def test_initial_states_are_gymnasiums():
    assert_initial_states_agree("humanoid", "v5", reset_noise_scale=0.2)
