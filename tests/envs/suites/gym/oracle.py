"""Gymnasium as the oracle."""

import gymnasium
import mujoco
import numpy as np

from hitmdp_jax.physics import MjxEngine
from tests.envs.suites.parity import Oracle

GYMNASIUM_NAMES = {
    "halfcheetah": "HalfCheetah",
    "swimmer": "Swimmer",
    "humanoidstandup": "HumanoidStandup",
    "reacher": "Reacher",
    "walker2d": "Walker2d",
    "hopper": "Hopper",
    "invertedpendulum": "InvertedPendulum",
    "inverteddoublependulum": "InvertedDoublePendulum",
    "ant": "Ant",
    "humanoid": "Humanoid",
}
# Version 4 has other names for some terms; ours are version 5's.
V4_TERMS = {
    "reward_run": "reward_forward",
    "reward_fwd": "reward_forward",
    "reward_linvel": "reward_forward",
    "reward_quadctrl": "reward_ctrl",
    "reward_alive": "reward_survive",
}


class GymnasiumTask(Oracle):
    """A task of Gymnasium's."""

    def __init__(self, name, version="v5", **keywords):
        known = f"{GYMNASIUM_NAMES[name]}-{version}"
        self.env = gymnasium.make(known, **keywords).unwrapped
        self.low, self.high = self.env.action_space.low, self.env.action_space.high
        self.dt, self.limit = self.env.dt, gymnasium.spec(known).max_episode_steps

    def as_in(self, env):
        """Take over the solver and the friction cone of our model; return the oracle."""
        model, ours = self.env.model, env.model
        model.opt.solver, model.opt.cone = ours.opt.solver, ours.opt.cone
        return self

    def reset(self, rng):
        self.env.reset(seed=int(rng.integers(2**31)))

    def state(self):
        return np.float32(self.env.data.qpos), np.float32(self.env.data.qvel)

    def set_state(self, qpos, qvel):
        mujoco.mj_resetData(self.env.model, self.env.data)  # the warm start and the forces, too
        self.env.set_state(np.float64(qpos), np.float64(qvel))
        return self.env._get_obs()

    def step(self, action):
        obs, reward, terminated, _, info = self.env.step(action)
        terms = {name: x for name, x in info.items() if np.ndim(x) == 0}
        return obs, reward, terminated, terms | {V4_TERMS.get(n, n): x for n, x in terms.items()}

    def initial_states(self, number):
        states = []
        self.env.set_state = lambda qpos, qvel: states.append(np.concatenate([qpos, qvel]))
        self.env._get_obs = lambda: None
        self.env.reset(seed=0)
        for _ in range(number - 1):
            self.env.reset_model()
        return np.array(states)


class MjxWithEllipticCones(MjxEngine):
    """MJX with elliptic friction cones.

    Cones have no orientation. Gymnasium's models have pyramids, which MJX lays along other axes
    than MuJoCo C does where a capsule stands steeply on the floor.
    """

    def prepare(self, model, budget=None):
        super().prepare(model, budget)
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
