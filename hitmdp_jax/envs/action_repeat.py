"""Holding each action for several control steps: temporal abstraction without options."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State, Wrapper

from hitmdp_jax.envs.spec import Spec, spec_of

CLOCK = "control_steps"  # in `State.info`, of the episode so far


class ActionRepeat(Wrapper):
    """Holds each action for N control steps and adds up their rewards, undiscounted.

    The hold ends early where the task ends the episode, and at the task's time limit: an episode is
    as long as without the wrapper. Reward terms in `state.metrics` are added up, too: those that
    the task lists in its `reward_terms`, and all that have "reward" in their names, as Brax's and
    Playground's have. Whatever else the task reports there is that of the last control step.

    Args:
      env: the task, unbatched and without auto-reset.
      action_repeat: N.

    Attributes:
      episode_length: the task's time limit in control steps, not in actions.
      action_repeat: N.
    """

    def __init__(self, env: Env, action_repeat: int):
        super().__init__(env)
        self.action_repeat = action_repeat
        self.episode_length = self.spec.episode_length
        self._listed = getattr(env, "reward_terms", ())

    def reset(self, rng: jax.Array) -> State:
        """Start an episode from the task's initial distribution."""
        return _with_clock(self.env.reset(rng), jnp.zeros((), jnp.int32))

    def reset_to(self, qpos: jax.Array, qvel: jax.Array) -> State:
        """Start an episode of a MuJoCo task from given coordinates: qpos [nq], qvel [nv]."""
        state = self.env.reset_to(qpos, qvel)  # pyright: ignore[reportAttributeAccessIssue]
        return _with_clock(state, jnp.zeros((), jnp.int32))

    def step(self, state: State, action: jax.Array) -> State:
        """Hold `action` [A] for N control steps, or until the episode's end."""
        info = dict(state.info)
        clock = info.pop(CLOCK)
        terms = [name for name in state.metrics if name in self._listed or "reward" in name]
        nothing = {name: jnp.zeros_like(state.metrics[name]) for name in terms}
        held = state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            reward=jnp.zeros_like(state.reward),
            done=jnp.zeros_like(state.done),
            metrics=state.metrics | nothing,
            info=info,
        )

        def control_step(carry: tuple[State, jax.Array], _: None):
            held, clock = carry
            # Brax's tasks write into the dictionaries of the state that they are given.
            given = held.replace(  # pyright: ignore[reportAttributeAccessIssue]
                metrics=dict(held.metrics), info=dict(held.info)
            )
            after = self.env.step(given, action)
            sums = {name: held.metrics[name] + after.metrics[name] for name in terms}
            after = after.replace(  # pyright: ignore[reportAttributeAccessIssue]
                reward=held.reward + after.reward, metrics=after.metrics | sums
            )
            goes_on = (held.done == 0) & (clock < self.episode_length)
            held = jax.tree.map(lambda a, b: jnp.where(goes_on, a, b), after, held)
            return (held, clock + goes_on), None

        (held, clock), _ = jax.lax.scan(control_step, (held, clock), length=self.action_repeat)
        return _with_clock(held, clock)

    @functools.cached_property
    def spec(self) -> Spec:
        """The task's, but for the seconds for which an action is held."""
        spec = spec_of(self.env)
        dt = None if spec.dt is None else self.action_repeat * spec.dt
        return dataclasses.replace(spec, dt=dt)

    @property
    def dt(self) -> float | None:
        """Seconds for which an action is held."""
        return self.spec.dt


def action_repeat_of(env: Env) -> int:
    """Return for how many control steps an environment holds each action; 1 for most."""
    return env.action_repeat if isinstance(env, ActionRepeat) else 1


def steps_taken(before: State, after: State) -> jax.Array | int:
    """Return the control steps that lie between a state and the one that a step leads to."""
    return after.info[CLOCK] - before.info[CLOCK] if CLOCK in after.info else 1


def _with_clock(state: State, clock: jax.Array) -> State:
    info = state.info | {CLOCK: clock}
    return state.replace(info=info)  # pyright: ignore[reportAttributeAccessIssue]
