"""Every task and version steps, ends and starts as Gymnasium's of that name."""

import numpy as np
import pytest

from hitmdp_jax import make_env
from tests.envs.suites.gym.oracle import GYMNASIUM_NAMES, GymnasiumTask, MjxWithEllipticCones
from tests.envs.suites.gym.trained_states import trained_states
from tests.envs.suites.parity import (
    assert_initial_states_agree,
    assert_steps_agree,
    random_states,
)

VERSIONS = ("v4", "v5")
SLOW = [pytest.mark.slow, pytest.mark.timeout(1800)]  # half a minute to several to compile
MJX_BY_DEFAULT = "halfcheetah"  # stands for all
CONTACTS = {"share": 0.9, "tolerance": 2e-3}  # float32 makes contacts that float64 misses
RUNNER = {
    "forward_reward_weight": 2.0,
    "ctrl_cost_weight": 0.5,
    "exclude_current_positions_from_observation": False,
}
HEALTH = {"healthy_reward": 0.3, "terminate_when_unhealthy": False}
HUMANOID = {
    "ctrl_cost_weight": 0.2,
    "exclude_current_positions_from_observation": False,
    "include_cinert_in_observation": False,
    "include_qfrc_actuator_in_observation": False,
}
WALKER = {**RUNNER, **HEALTH, "healthy_angle_range": (-0.05, 0.1)}
ANT = {
    **HEALTH,
    "ctrl_cost_weight": 0.2,
    "contact_cost_weight": 0.1,
    "healthy_z_range": (0.4, 0.7),
    "contact_force_range": (-0.5, 2.0),
    "exclude_current_positions_from_observation": False,
}
KEYWORDS = [  # task, versions that take them, keywords
    ("halfcheetah", VERSIONS, RUNNER),
    ("swimmer", VERSIONS, RUNNER),
    ("walker2d", VERSIONS, {**WALKER, "healthy_z_range": (1.15, 1.24)}),
    (
        "hopper",
        VERSIONS,
        {**WALKER, "healthy_z_range": (1.1, 1.24), "healthy_state_range": (-3.0, 2.0)},
    ),
    ("reacher", ["v5"], {"reward_dist_weight": 2.0, "reward_control_weight": 0.3}),
    ("inverteddoublependulum", ["v5"], {"healthy_reward": 3.0}),
    ("ant", VERSIONS, ANT),
    ("ant", ["v5"], {"include_cfrc_ext_in_observation": False, "main_body": 4}),
    ("ant", ["v4"], {"use_contact_forces": True}),
    (
        "humanoid",
        ["v5"],
        {
            **HUMANOID,
            **HEALTH,
            "forward_reward_weight": 0.5,
            "healthy_z_range": (1.2, 1.4),
            "contact_cost_weight": 1e-3,
            "contact_cost_range": (0.1, 5.0),
        },
    ),
    (
        "humanoidstandup",
        ["v5"],
        {**HUMANOID, "impact_cost_weight": 1e-3, "impact_cost_range": (0.1, 5.0)},
    ),
]


def assert_agree(name, version, physics, keywords=None, **how):
    """From 100 states of random trajectories, healthy or not, and 100 of a trained policy's.

    Gymnasium gets the solver and the friction cones of our model, which are its own in MuJoCo C.
    """
    keywords = keywords or {}
    env = make_env(name, physics=physics, version=version, **keywords)
    oracle = GymnasiumTask(name, version, **keywords).as_in(env)
    states = zip(random_states(oracle), trained_states(name), strict=True)
    assert_steps_agree(env, oracle, [np.concatenate(parts) for parts in states], **how)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", GYMNASIUM_NAMES)
def test_native_steps_as_gymnasium(name, version):
    assert_agree(name, version, "native")


@pytest.mark.parametrize(
    ("name", "version", "keywords"),
    [(name, version, keywords) for name, versions, keywords in KEYWORDS for version in versions],
)
def test_keywords_mean_what_they_mean_in_gymnasium(name, version, keywords):
    # With contact forces in version 4, Gymnasium reports their cost as its `reward_ctrl`.
    ignored = ["reward_ctrl"] if keywords.get("use_contact_forces") else []
    assert_agree(name, version, "native", keywords, ignored=ignored)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name == MJX_BY_DEFAULT else SLOW) for name in GYMNASIUM_NAMES],
)
def test_mjx_steps_as_gymnasium(name):
    """In version 5: what distinguishes version 4 is the same code in every engine."""
    how = CONTACTS if name in ("ant", "humanoid", "humanoidstandup") else {}
    engine = MjxWithEllipticCones(full_budget=True) if name == "ant" else "mjx"
    assert_agree(name, "v5", engine, num_steps=1, **how)


@pytest.mark.parametrize("name", GYMNASIUM_NAMES)
def test_initial_states_are_gymnasiums(name):
    keywords = {} if name == "reacher" else {"reset_noise_scale": 0.2}
    env = make_env(name, physics="native", **keywords)
    assert_initial_states_agree(env, GymnasiumTask(name, **keywords), 10_000, bound=0.01)
