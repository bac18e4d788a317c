"""DeepMind Control as the oracle."""

import mujoco
import numpy as np
from dm_control.mujoco.wrapper.mjbindings import sizes

from tests.envs.suites.parity import Oracle

# dm_control lists the fields of MuJoCo's structures, among them some that MuJoCo 4 no longer has,
# and looks for each of them whenever it loads a model.
_MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
for _name, _struct in (("mjmodel", _MODEL), ("mjdata", mujoco.MjData(_MODEL))):
    for _field in [field for field in sizes.array_sizes[_name] if not hasattr(_struct, field)]:
        del sizes.array_sizes[_name][_field]

from dm_control import suite  # noqa: E402


class SuiteTask(Oracle):
    """A task of the suite, or one that it lacks: one of its tasks with another reward.

    Args:
      domain: its domain.
      task: its name there.
      reward: physics -> reward, where it is not the suite's.
      drawn_geom: whose place in the model an episode draws; our state holds it behind the joints.
    """

    def __init__(self, domain, task, reward=None, drawn_geom=None):
        self.domain, self.drawn_geom = domain, drawn_geom
        self.env = suite.load(domain, task, task_kwargs={"random": 0})
        if reward is not None:
            self.env.task.get_reward = reward
        self.physics, spec = self.env.physics, self.env.action_spec()
        self.low, self.high = spec.minimum, spec.maximum
        self.dt, self.limit = self.env.control_timestep(), round(self.env._step_limit)

    def reset(self, rng):
        self.env.reset()

    def state(self):
        qpos, qvel = self.physics.data.qpos, self.physics.data.qvel
        if self.drawn_geom is not None:
            place = self.physics.named.model.geom_pos[self.drawn_geom, :2]
            qpos, qvel = np.append(qpos, place), np.append(qvel, np.zeros(2))
        return np.float32(qpos), np.float32(qvel)

    def set_state(self, qpos, qvel):
        nq, nv = self.physics.model.nq, self.physics.model.nv
        if self.env._reset_next_step:
            self.env.reset()
        self.env._step_count = 0  # far from the time limit
        with self.physics.reset_context():
            self.physics.data.qpos[:], self.physics.data.qvel[:] = qpos[:nq], qvel[:nv]
            if self.drawn_geom is not None:
                self.physics.named.model.geom_pos[self.drawn_geom, :2] = qpos[nq:]
        return _flat(self.env.task.get_observation(self.physics))

    def step(self, action):
        step = self.env.step(action)
        return _flat(step.observation), step.reward, False, {}


def _flat(observation):
    return np.concatenate([np.ravel(value) for value in observation.values()])
