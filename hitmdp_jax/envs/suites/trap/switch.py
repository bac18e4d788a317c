"""Switches: the goal in front counts only after a switch behind was touched."""

import dataclasses
import functools
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import mujoco
from brax.envs.base import State

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import Drawn, MujocoEnv, Parts, SolverBudget
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.envs.suites.gym import ant
from hitmdp_jax.envs.suites.gym.half_cheetah import HalfCheetah
from hitmdp_jax.envs.suites.gym.initial import normal_velocity_around_rest
from hitmdp_jax.envs.suites.maze.maze import RewardType
from hitmdp_jax.envs.suites.trap.ant import TrappedAnt, integrate_by_euler
from hitmdp_jax.errors import out_of_domain
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

ROOT_X = 0  # qpos: the torso's x, m
TOUCHED = "touched"  # in `State.info`: 1 once the switch was touched
GOAL_REWARD = 20.0


@dataclasses.dataclass(eq=False, repr=False)
class SwitchEnv(MujocoEnv):
    """Run back to a switch, then forward past the start to the goal.

    The robot stands at x = 0. The goal is at x = `distance`, but it pays (20) and ends the episode
    only once the robot has been at the switch, at x = -`distance`. "dense" rewards also pay the
    step's progress towards the goal (m) less what the squared action costs. Running straight to the
    goal then earns almost `distance`, and waiting there earns nothing more: that is the trap.

    The observation's parts are "place", "body" and "goal": where the torso is, the robot's own, and
    1 once the switch was touched, else 0. `state.metrics["success"]` is 1 where the goal is reached
    in time.

    Args:
      physics: the engine; see `MujocoEnv`.
      distance: of the goal and of the switch from the start, m.
      reward_type: "dense" or "sparse".
    """

    reward_terms = ("reward_goal", "reward_progress", "reward_ctrl")
    model_file: ClassVar[str]
    frame_skip: ClassVar[int]
    solver_budget: ClassVar[SolverBudget]
    places: ClassVar[int]  # entries of qpos that say where the torso is on the floor
    steps_per_metre: ClassVar[int]  # of the time limit; the way is three times the distance
    action_cost: ClassVar[float]  # of the squared action
    mark: ClassVar[tuple[float, float, float]]  # half the sides of what shows switch and goal, m

    physics: dataclasses.InitVar[PhysicsChoice] = "mjx"  # pyright: ignore
    _: dataclasses.KW_ONLY
    distance: float = 3.0
    reward_type: RewardType = "dense"

    def __post_init__(self, physics: PhysicsChoice):
        if not self.distance > 0:
            raise out_of_domain("distance", self.distance, "a number above 0, in m")
        model = load_gymnasium_model(self.model_file, self._edit)
        MujocoEnv.__init__(self, model, self.frame_skip, physics, mjx_budget=self.solver_budget)
        self.episode_length = max(1, round(self.steps_per_metre * self.distance))

    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw qpos uniformly and qvel normally around the standing pose."""
        return normal_velocity_around_rest(self.model, key, 0.1)

    def reset_to(self, qpos: jax.Array, qvel: jax.Array, drawn: Drawn | None = None) -> State:
        """Start an episode from given coordinates, the switch not yet touched."""
        state: Any = super().reset_to(qpos, qvel, drawn)
        zero = jnp.zeros((), jnp.float32)
        return state.replace(
            obs=jnp.append(state.obs, zero),
            metrics=state.metrics | {"success": zero},
            info=state.info | {TOUCHED: zero},
        )

    def step(self, state: State, action: jax.Array) -> State:
        """Advance one control step; see `MujocoEnv.step`."""
        full: Any = state
        # `MujocoEnv` knows the observation without its last entry.
        after: Any = super().step(full.replace(obs=full.obs[:-1]), action)
        data: PhysicsState = after.pipeline_state
        x, stable = data.qpos[ROOT_X], 1.0 - after.metrics["unstable"]
        touched = jnp.maximum(state.info[TOUCHED], (x <= -self.distance).astype(jnp.float32))
        success = touched * (x >= self.distance) * stable
        prize = GOAL_REWARD * success
        return after.replace(
            obs=jnp.append(after.obs, touched),
            reward=after.reward + prize,
            done=jnp.maximum(after.done, success),
            metrics=after.metrics | {"success": success, "reward_goal": prize},
            info=state.info | {TOUCHED: touched},
        )

    @property
    def parts(self) -> Parts:
        """Where the robot is, and whether the goal counts."""
        return {"place": slice(self.places), "goal": slice(-1, None)}

    @functools.cached_property
    def spec(self) -> Spec:
        """The task's observations and actions; the switch has its name among them."""
        spec = super().spec
        names = (*spec.observation.names, "switch touched")
        observation = dataclasses.replace(spec.observation, names=names)
        return dataclasses.replace(spec, observation=observation)

    def observation(self, data: PhysicsState) -> jax.Array:
        """Return positions and velocities; whether the switch was touched is added behind them."""
        return jnp.concatenate([data.qpos, data.qvel])

    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return what the step itself pays, without the prize."""
        zero = jnp.zeros((), jnp.float32)
        dense = self.reward_type == "dense"
        nearer = self._away(before) - self._away(after)
        progress = nearer if dense else zero
        ctrl = -self.action_cost * jnp.sum(action**2) if dense else zero
        terms = {"reward_goal": zero, "reward_progress": progress, "reward_ctrl": ctrl}
        return progress + ctrl, terms

    def _away(self, data: PhysicsState) -> jax.Array:
        return jnp.abs(self.distance - data.qpos[ROOT_X])

    def _edit(self, spec: mujoco.MjSpec) -> None:
        """Show the switch (blue) and the goal (red), which touch nothing."""
        box = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": self.mark}
        for name, x, rgba in (
            ("switch", -self.distance, [0.2, 0.4, 1.0, 0.6]),
            ("goal", self.distance, [1.0, 0.2, 0.2, 0.6]),
        ):
            spec.worldbody.add_site(name=name, pos=[x, 0.0, self.mark[2]], rgba=rgba, **box)


@dataclasses.dataclass(eq=False, repr=False)
class CheetahSwitch(SwitchEnv):
    """`SwitchEnv` with HalfCheetah, whose squared action costs 0.01.

    Observation [19]: the torso's x (m), HalfCheetah's own 17, and whether the switch was touched.
    Action [6]: torques in [-1, 1]. The time limit is 100 steps of 0.05 s for each metre of
    `distance`.

    Args:
      **keywords: see `SwitchEnv`.
    """

    model_file = "half_cheetah.xml"
    frame_skip = HalfCheetah.frame_skip
    solver_budget = HalfCheetah.mjx_budget
    places = 1
    steps_per_metre = 100
    action_cost = 0.01
    mark = (0.05, 0.5, 0.5)


@dataclasses.dataclass(eq=False, repr=False)
class AntSwitch(TrappedAnt, SwitchEnv):
    """`SwitchEnv` with the ant, whose actions cost nothing.

    Observation [30]: the torso's x and y (m), the 27 of `Ant` without contact forces, and whether
    the switch was touched. Switch and goal are lines across the floor: y does not matter. Action
    [8]: torques on hips and ankles in [-1, 1]. The time limit is 200 steps of 0.05 s for each metre
    of `distance`. An ant on its back ends the episode, and motions are integrated by Euler's method
    (`TrappedAnt`).

    Args:
      **keywords: see `SwitchEnv`.
    """

    model_file = "ant.xml"
    frame_skip = ant.FRAME_SKIP
    solver_budget = ant.MJX_BUDGET
    places = 2
    steps_per_metre = 200
    action_cost = 0.0
    mark = (0.05, 20.0, 0.01)

    def _edit(self, spec: mujoco.MjSpec) -> None:
        super()._edit(spec)
        integrate_by_euler(spec)
