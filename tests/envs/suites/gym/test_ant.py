import pytest

from tests.envs.suites.gym.parity import (
    MjxWithEllipticCones,
    assert_initial_states_agree,
    assert_steps_agree,
)


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_native_steps_as_gymnasium(version):
    assert_steps_agree("ant", version, "native")


@pytest.mark.slow
@pytest.mark.parametrize("version", ["v4", "v5"])
def test_mjx_steps_as_gymnasium_with_elliptic_cones(version):
    assert_steps_agree(
        "ant",
        version,
        MjxWithEllipticCones(full_budget=True),
        num_steps=1,
        tolerance=2e-3,
        share=0.9,
    )


@pytest.mark.parametrize("version", ["v4", "v5"])
def test_keywords_mean_what_they_mean_in_gymnasium(version):
    assert_steps_agree(
        "ant",
        version,
        "native",
        ctrl_cost_weight=0.2,
        contact_cost_weight=0.1,
        healthy_reward=0.3,
        terminate_when_unhealthy=False,
        healthy_z_range=(0.4, 0.7),
        contact_force_range=(-0.5, 2.0),
        exclude_current_positions_from_observation=False,
    )


def test_contact_forces_can_be_paid_without_being_observed():
    assert_steps_agree("ant", "v5", "native", include_cfrc_ext_in_observation=False, main_body=4)


def test_version_4_can_use_contact_forces():
    # Gymnasium then reports the contact cost as its `reward_ctrl`.
    assert_steps_agree(
        "ant", "v4", "native", ignored_terms=["reward_ctrl"], use_contact_forces=True
    )


def test_initial_states_are_gymnasiums():
    assert_initial_states_agree("ant", "v5", reset_noise_scale=0.2)
