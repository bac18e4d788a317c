"""`CheetahSwitch`: the goal in front counts only after a switch behind was touched."""

import dataclasses
import functools
from typing import Any, Literal

import jax
import jax.numpy as jnp
import mujoco
from brax.envs.base import State

from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import Drawn, MujocoEnv, Parts
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.envs.suites.gym.half_cheetah import HalfCheetah
from hitmdp_jax.envs.suites.gym.initial import normal_velocity_around_rest
from hitmdp_jax.errors import out_of_domain
from hitmdp_jax.physics import PhysicsChoice, PhysicsState

ROOT_X = 0  # qpos: the torso's x, m
TOUCHED = "touched"  # in `State.info`: 1 once the switch was touched
GOAL_REWARD = 20.0
STEPS_PER_METRE = 100  # of the time limit; the way is three times the distance


@dataclasses.dataclass(eq=False, repr=False)
class CheetahSwitch(MujocoEnv):
    """Run back to a switch, then forward past the start to the goal.

    HalfCheetah stands at x = 0. The goal is at x = `distance`, but it pays (20) and ends the
    episode only once the robot has been at the switch, at x = -`distance`. "dense" rewards also pay
    the step's progress towards the goal (m) less 0.01 of the squared action. Running straight to
    the goal then earns almost `distance`, and waiting there earns nothing more: that is the trap.

    Observation [19]: the torso's x (m), HalfCheetah's own 17, and 1 once the switch was touched,
    else 0; the parts are "place", "body" and "goal". Action [6]: torques in [-1, 1]. The time limit
    is 100 steps of 0.05 s for each metre of `distance`. `state.metrics["success"]` is 1 where the
    goal is reached in time.

    Args:
      physics: the engine; see `MujocoEnv`.
      distance: of the goal and of the switch from the start, m.
      reward_type: "dense" or "sparse".
    """

    reward_terms = ("reward_goal", "reward_progress", "reward_ctrl")

    physics: dataclasses.InitVar[PhysicsChoice] = "mjx"  # pyright: ignore
    _: dataclasses.KW_ONLY
    distance: float = 3.0
    reward_type: Literal["dense", "sparse"] = "dense"

    def __post_init__(self, physics: PhysicsChoice):
        if not self.distance > 0:
            raise out_of_domain("distance", self.distance, "a number above 0, in m")
        model = load_gymnasium_model("half_cheetah.xml", self._edit)
        body = HalfCheetah
        MujocoEnv.__init__(self, model, body.frame_skip, physics, mjx_budget=body.mjx_budget)
        self.episode_length = max(1, round(STEPS_PER_METRE * self.distance))

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
        return {"place": slice(0, 1), "goal": slice(-1, None)}

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
        ctrl = -0.01 * jnp.sum(action**2) if dense else zero
        terms = {"reward_goal": zero, "reward_progress": progress, "reward_ctrl": ctrl}
        return progress + ctrl, terms

    def _away(self, data: PhysicsState) -> jax.Array:
        return jnp.abs(self.distance - data.qpos[ROOT_X])

    def _edit(self, spec: mujoco.MjSpec) -> None:
        """Show the switch (blue) and the goal (red), which touch nothing."""
        box = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [0.05, 0.5, 0.5]}
        for name, x, rgba in (
            ("switch", -self.distance, [0.2, 0.4, 1.0, 0.6]),
            ("goal", self.distance, [1.0, 0.2, 0.2, 0.6]),
        ):
            spec.worldbody.add_site(name=name, pos=[x, 0.0, 0.5], rgba=rgba, **box)
