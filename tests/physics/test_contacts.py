"""The contacts that MJX may solve for are as many as MuJoCo C ever finds."""

import mujoco
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.physics import MjxEngine
from hitmdp_jax.physics.base import CONTACTS

TASKS = ("halfcheetah", "ant", "humanoid", "humanoidstandup", "dmc/cheetah_run")


def most_contacts(model, frame_skip, episodes=12, steps=100):
    """Return how many contacts of a dimension there are at most: upright, thrown, or lying limp."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    low, high = model.actuator_ctrlrange.T
    most = 0
    for episode in range(episodes):
        mujoco.mj_resetData(model, data)
        if episode % 3 == 1:
            data.qvel[:] = 3.0 * rng.normal(size=model.nv)
        if episode % 3 == 2 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
            data.qpos[3:7] = rng.normal(size=4)  # MuJoCo makes a unit quaternion of it
        effort, hold = episode % 4 > 0, 1 + 5 * (episode % 7)
        for step in range(steps):
            if step % hold == 0:
                data.ctrl[:] = effort * rng.uniform(low, high)
            for _ in range(frame_skip):
                mujoco.mj_step(model, data)
                counts = np.bincount(data.contact.dim, minlength=1)
                most = max(most, counts.max())
    return most


@pytest.mark.parametrize("name", TASKS)
def test_no_contact_is_left_out(name):
    env = hitmdp_jax.make_env(name, physics="mjx")
    budget = env.model.numeric(CONTACTS).data[0]
    assert 0 < most_contacts(env.model, env.physics.frame_skip) <= budget
    pairs = MjxEngine(full_budget=True)
    whole = hitmdp_jax.make_env(name, physics=pairs).physics
    assert whole.model.numeric(CONTACTS).data[0] == -1
    assert env.physics._blank._impl.nefc < whole._blank._impl.nefc
