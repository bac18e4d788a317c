"""`Runner` and `HealthyRunner`: what Gymnasium's planar bodies that move along x share."""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.suites.gym.initial import uniform_around_rest
from hitmdp_jax.envs.suites.gym.task import GymTask, HealthyTask, Terms
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

ROOT_X = 0  # qpos: horizontal position of the root, m
MAX_OBSERVED_VELOCITY = 10.0  # m/s or rad/s, of a `HealthyRunner`


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class Runner(GymTask):
    """A planar body whose reward is its velocity along x (m/s) less a control cost.

    It observes its positions, then its generalised velocities. A subclass says the model's file,
    how many substeps a control step has, and the solver's budget under MJX.

    Args:
      forward_reward_weight: weight of the velocity along x.
      ctrl_cost_weight: weight of the squared action.
      reset_noise_scale: half-width of the uniform noise on qpos and qvel.
      exclude_current_positions_from_observation: leave where the body is out of the observation.
      hide_velocities: leave the velocities out of the observation.
    """

    reward_terms = ("reward_forward", "reward_ctrl")
    traced: ClassVar[tuple[str, ...]] = ("forward_reward_weight", "ctrl_cost_weight")
    model_files: ClassVar[Mapping[str, str]]  # version -> the file among Gymnasium's
    frame_skip: ClassVar[int]
    mjx_budget: ClassVar[SolverBudget]
    places: ClassVar[int] = 1  # the first entries of qpos, which say where the body is

    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 0.1
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = True
    hide_velocities: bool = False

    def __post_init__(self, physics: PhysicsChoice):
        model = load_gymnasium_model(self.model_files[self.version])
        MujocoEnv.__init__(self, model, self.frame_skip, physics, mjx_budget=self.mjx_budget)
        excluded = self.exclude_current_positions_from_observation
        self._first_position = self.places if excluded else 0
        self._observed_velocities = 0 if self.hide_velocities else model.nv

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos and qvel uniformly around the pose at rest."""
        return uniform_around_rest(self.model, key, self.reset_noise_scale)

    @property
    def parts(self) -> Parts:
        """Where the body is, where that is observed."""
        return {"place": slice(self.places - self._first_position)}

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions and velocities."""
        velocity = data.qvel[: self._observed_velocities]
        return jnp.concatenate([data.qpos[self._first_position :], velocity])

    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return velocity along x and control cost, both weighted."""
        forward = self.forward_reward_weight * after.displacement[ROOT_X] / self.dt
        ctrl = -self.ctrl_cost_weight * jnp.sum(action**2)
        return {"reward_forward": forward, "reward_ctrl": ctrl}


@dataclasses.dataclass(eq=False, repr=False, kw_only=True)
class HealthyRunner(HealthyTask, Runner):
    """A runner that is paid for staying healthy, and whose episode ends where it does not.

    Its observed velocities are clipped to [-10, 10].

    Args:
      healthy_reward: reward of a healthy step.
      terminate_when_unhealthy: whether the episode ends there.
    """

    reward_terms = (*Runner.reward_terms, "reward_survive")
    traced = (*Runner.traced, "healthy_reward")

    ctrl_cost_weight: float = 1e-3
    reset_noise_scale: float = 5e-3

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions and clipped velocities."""
        clipped = jnp.clip(data.qvel, -MAX_OBSERVED_VELOCITY, MAX_OBSERVED_VELOCITY)
        return super().observation(data.replace(qvel=clipped))

    def terms(self, before: PhysicsState, after: PhysicsState, action: jax.Array) -> Terms:
        """Return velocity along x, control cost and the healthy reward."""
        earned = super().terms(before, after, action)
        return earned | {"reward_survive": self.survive_reward(after)}
