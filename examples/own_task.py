"""A task of your own, on a MuJoCo model of your own: swing a pendulum up and hold it there.

python train.py env=examples/own_task.py:Pendulum env.torque_cost_weight=0.1 physics=native
"""

import math

import jax
import jax.numpy as jnp

import hitmdp_jax
from hitmdp_jax.envs.assets import load_model
from hitmdp_jax.envs.base import MujocoEnv

MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.04" mass="1" contype="0"/>
    </body>
  </worldbody>
  <actuator> <motor joint="hinge" gear="1.5" ctrllimited="true" ctrlrange="-1 1"/> </actuator>
</mujoco>
"""


class Pendulum(MujocoEnv):
    """Reward: height of the tip in lengths of the pole, from -1 to 1, less a cost of torque."""

    episode_length = 200  # steps of 0.05 s
    reward_terms = ("reward_height", "reward_torque")

    def __init__(self, physics="mjx", *, torque_cost_weight=0.01):
        super().__init__(load_model(MODEL), frame_skip=5, physics=physics)
        self._torque_cost_weight = torque_cost_weight

    def sample_initial(self, key):
        """Draw an angle (rad) anywhere, 0 hanging, and start at rest."""
        return jax.random.uniform(key, (1,), minval=-math.pi, maxval=math.pi), jnp.zeros(1)

    def observation(self, data):
        """Return the angle's cosine and sine, and the angular velocity (rad/s)."""
        return jnp.concatenate([jnp.cos(data.qpos), jnp.sin(data.qpos), data.qvel])

    def reward(self, before, after, action):
        """Return the reward and its two terms."""
        height = -jnp.cos(after.qpos[0])
        torque = -self._torque_cost_weight * jnp.sum(action**2)
        return height + torque, {"reward_height": height, "reward_torque": torque}


if __name__ == "__main__":
    hitmdp_jax.register_env("pendulum", Pendulum)  # or name it by file, as above
    env = hitmdp_jax.make_env("pendulum", torque_cost_weight=0.1)
    print(env.reset(jax.random.key(0)).obs)
