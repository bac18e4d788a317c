"""What the ants of all traps have in common: they must stay on their feet."""

import jax
import mujoco
from brax.envs.base import State

from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.suites.gym.ant import on_its_back
from hitmdp_jax.physics import PhysicsState

ON_ITS_FEET = 1.0  # m/s, as `Ant` pays for a healthy step


def integrate_by_euler(spec: mujoco.MjSpec) -> None:
    """Let MuJoCo integrate motions by Euler's method.

    It computes the forces once in a substep, and `Ant`'s Runge-Kutta method four times.
    """
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER


class TrappedAnt(MujocoEnv):
    """An ant whose episode ends when it is on its back.

    Otherwise an untrained ant would spend most of its time there. The rewards for options are the
    velocities plus 1 m/s for each step: falling costs an option what would have followed. `Ant`
    pays as much for health; its version v4 pays for the last step of an episode, too, as here. The
    task itself pays nothing for staying up.

    Args:
      physics: the engine; see `MujocoEnv`.
    """

    def terminated(self, data: PhysicsState) -> jax.Array:
        """Return whether the task ends the episode, or the ant is on its back."""
        return super().terminated(data) | on_its_back(data)

    def option_rewards(
        self, before: State, action: jax.Array, after: State
    ) -> dict[str, jax.Array]:
        """Return the velocities along the directions (m/s), plus 1 for each step."""
        velocities = super().option_rewards(before, action, after)
        return {name: velocity + ON_ITS_FEET for name, velocity in velocities.items()}
