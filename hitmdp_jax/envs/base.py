"""`MujocoEnv`: a task written once as pure functions of the physics it reads."""

import abc
import copy
import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from brax.envs.base import Env, State

from hitmdp_jax.envs.names import actuator_names, observation_names
from hitmdp_jax.envs.option_rewards import directions_of
from hitmdp_jax.envs.spec import Box, Observation, Spec
from hitmdp_jax.physics import PhysicsChoice, PhysicsState, SolverBudget, find_engine
from hitmdp_jax.precision import in_32_bits

__all__ = ["MujocoEnv", "SolverBudget", "has_model"]

Parts = Mapping[str, slice | Sequence[int]]  # of an observation: name -> where it lies in the row
Drawn = Mapping[str, jax.Array]  # fields of the model that are an episode's own, by name
OF_MODEL = 0x6D0DE1  # sets its key apart from all that a task splits off the episode's
UNLIMITED = [[-np.inf], [np.inf]]  # of an actuator's control


class MujocoEnv(Env):
    """A MuJoCo task behind Brax's `Env` interface, unbatched and without auto-reset.

    A subclass states what distinguishes the task: `sample_initial`, `observation`, `reward` and
    `terminated`. Actions are clipped to the actuators' range. The states are Brax's `State`;
    `state.pipeline_state` is a `PhysicsState`, `state.metrics` holds each reward term by name.

    Args:
      model: the compiled model; the engine's changes are made to a copy.
      frame_skip: physics substeps in one control step.
      physics: an engine or its name: "mjx", "native" or "warp".
      fields: names of the derived MjData fields the task reads.
      mjx_budget: solver iterations for MJX; None keeps the model's own.
      current_fields: read derived fields of position and velocity at the state after the step, as
        DeepMind Control does, and not a substep behind it, as Gymnasium does.

    Raises:
      UsageError: there is no such engine, its extra is missing, or it cannot run the task.

    Attributes:
      episode_length: the task's time limit in control steps; applied by `VectorEnv`, not here.
      reward_terms: names of the reward terms in `state.metrics`, which also counts `unstable`.
    """

    episode_length: int = 1000
    reward_terms: tuple[str, ...] = ()

    def __init__(
        self,
        model: mujoco.MjModel,
        frame_skip: int,
        physics: PhysicsChoice = "mjx",
        fields: Sequence[str] = (),
        mjx_budget: SolverBudget | None = None,
        current_fields: bool = False,
    ):
        engine = find_engine(physics)
        engine.check()
        engine.check_task(model, fields)
        model = copy.copy(model)
        engine.prepare(model, mjx_budget)
        self.physics = engine.build(model, frame_skip, fields, current_fields)
        self.model = model
        low, high = np.where(model.actuator_ctrllimited, model.actuator_ctrlrange.T, UNLIMITED)
        self._action = Box(tuple(low.tolist()), tuple(high.tolist()), actuator_names(model))

    @abc.abstractmethod
    def sample_initial(self, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Draw an episode's first qpos [nq] and qvel [nv]."""

    @abc.abstractmethod
    def observation(self, data: PhysicsState) -> jax.Array:
        """Return the observation [O] of a physics state."""

    @abc.abstractmethod
    def reward(
        self, before: PhysicsState, after: PhysicsState, action: jax.Array
    ) -> tuple[jax.Array, dict[str, jax.Array]]:
        """Return the reward of a step and its terms by name."""

    def terminated(self, data: PhysicsState) -> jax.Array:
        """Return whether the episode ends here for a reason other than time. Never, by default."""
        return jnp.zeros((), bool)

    @property
    def parts(self) -> Parts:
        """Where in the observation its parts lie, by name; what none names is the "body".

        The body is how the robot is posed and moves, and what it feels. Tasks here may have a
        "place", where the robot is, and a "goal", what an episode asks for.
        """
        return {}

    def option_rewards(
        self, before: State, action: jax.Array, after: State
    ) -> dict[str, jax.Array]:
        """Return what a step can pay to options (`envs.option_rewards`).

        By default it is the root's velocity (m/s) in each direction in which the root can move. An
        action that is held for several steps is paid by the last of them.
        """
        names, along = directions_of(self.model)
        data = after.pipeline_state
        assert isinstance(data, PhysicsState)
        velocity = jnp.asarray(along, jnp.float32) @ data.displacement / self.dt
        return dict(zip(names, velocity, strict=True))

    def sample_model(self, key: jax.Array) -> Drawn:
        """Draw the fields of MuJoCo's MjModel that an episode has of its own, by name.

        The episode keeps them (`PhysicsState.drawn`); what is not drawn is the model's. Nothing is,
        by default. It is called domain randomization where policies are to cope with all of them.
        """
        return {}

    def reset(self, rng: jax.Array) -> State:
        """Start an episode from the task's initial distribution."""
        drawn = self.sample_model(jax.random.fold_in(rng, OF_MODEL))
        return self.reset_to(*self.sample_initial(rng), *([drawn] if drawn else []))

    def reset_to(self, qpos: jax.Array, qvel: jax.Array, drawn: Drawn | None = None) -> State:
        """Start an episode from given generalised coordinates: qpos [nq], qvel [nv].

        Args:
          qpos: positions.
          qvel: velocities.
          drawn: fields of the model that the episode has of its own, as `sample_model` draws them.
        """
        data = self.physics.initial(qpos, qvel, drawn)
        zero = jnp.zeros((), jnp.float32)
        state = State(
            pipeline_state=data,  # pyright: ignore[reportArgumentType]
            obs=self.observation(data),
            reward=zero,
            done=zero,
            metrics=dict.fromkeys((*self.reward_terms, "unstable"), zero),
        )
        return in_32_bits(state)

    def step(self, state: State, action: jax.Array) -> State:
        """Advance one control step of `dt` seconds under `action` [A].

        Where the simulation is lost (MuJoCo finds the state unstable, or an action is NaN) the
        episode ends with zero reward on the last good state, and `metrics["unstable"]` is 1.
        """
        before = state.pipeline_state
        assert isinstance(before, PhysicsState)
        action = self._action.clip(action)
        valid = ~jnp.isnan(action).any()
        action = jnp.where(valid, action, 0.0)
        after = self.physics.step(before, action)
        reward, terms = self.reward(before, after, action)
        zero, one = jnp.zeros((), jnp.float32), jnp.ones((), jnp.float32)
        terms = {name: terms[name] for name in self.reward_terms}
        good = state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            pipeline_state=after,
            obs=self.observation(after),
            reward=reward,
            done=self.terminated(after).astype(jnp.float32),
            metrics=state.metrics | terms | {"unstable": zero},  # wrappers keep theirs there, too
        )
        lost = state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            reward=zero,
            done=one,
            metrics=state.metrics | dict.fromkeys(terms, zero) | {"unstable": one},
        )
        stable = valid & ~after.unstable
        return jax.tree.map(lambda a, b: jnp.where(stable, a, b), in_32_bits(good), lost)

    @property
    def dt(self) -> float:
        """Seconds in one control step."""
        return self.model.opt.timestep * self.physics.frame_skip

    @functools.cached_property  # tracing MJX takes seconds
    def spec(self) -> Spec:
        """The task's observations, by what the model calls its coordinates, and its actions."""
        state: Any = jax.eval_shape(self.reset, jax.random.key(0))
        shape = state.obs.shape

        def observe(qpos: jax.Array, qvel: jax.Array) -> jax.Array:
            zeros = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), state.pipeline_state)
            return self.observation(zeros.replace(qpos=qpos, qvel=qvel))

        names = observation_names(self.model, observe) if len(shape) == 1 else ()
        parts = _in_order(shape, self.parts) if len(shape) == 1 else ()
        observed = Observation(shape, state.obs.dtype.name, names, parts)
        return Spec(observed, self._action, self.episode_length, self.dt)

    @property
    def observation_size(self) -> int:
        """Number of entries in an observation."""
        return self.spec.observation.size

    @property
    def action_size(self) -> int:
        """Number of actuators."""
        return self.model.nu

    @property
    def backend(self) -> str:
        """Name of the physics engine (Brax's word)."""
        return self.physics.name


def _in_order(shape: tuple[int, ...], parts: Parts) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Return the parts of an observation [O] as `Observation` lists them."""
    names = np.full(shape, "body", object)
    for name, where in parts.items():
        names[where if isinstance(where, slice) else list(where)] = name
    return tuple((name, (len(list(run)),)) for name, run in itertools.groupby(names.tolist()))


def has_model(env: Any) -> TypeGuard[MujocoEnv]:
    """Return whether an environment is a `MujocoEnv`, or a wrapper that hands on what one has."""
    return isinstance(getattr(env, "unwrapped", env), MujocoEnv)
