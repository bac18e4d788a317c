"""Rewards for options: what a task can pay one option for, whatever the task itself asks.

An environment offers them by a method `option_rewards(before, action, after)`. It gets Brax's
`State` before and after a step, unbatched, and returns scalars by name. Every MuJoCo task offers
the velocities of its root along the directions in which the root can move.
"""

import math
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from hitmdp_jax.errors import unknown_name

TASK = "task"  # the task's own reward, under this name
LEARNED = "learned"  # what an agent rewards itself with: the environment pays nothing
ALONG = ("forward", "backward")  # of a root that moves along x alone
COMPASS = (  # of a root that moves in the plane: anticlockwise from the x axis, 45 degrees each
    "east",
    "northeast",
    "north",
    "northwest",
    "west",
    "southwest",
    "south",
    "southeast",
)


def directions_of(model: mujoco.MjModel) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the directions in which a robot's root can move.

    Args:
      model: the task's; its root is its first moving body.

    Returns:
      The names of the D directions, and an array [D, nq]: the product of it and a change of the
      positions is the distance moved in each direction, m. A root that does not move along x has
      none.
    """
    along = np.zeros((2, model.nq))  # x and y
    first = int(model.jnt_bodyid[0])
    for joint in np.flatnonzero(model.jnt_bodyid == first):
        address, kind = model.jnt_qposadr[joint], model.jnt_type[joint]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            along[[0, 1], [address, address + 1]] = 1.0
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
            along[:, address] = model.jnt_axis[joint, :2]
    if not along[0].any():
        return (), np.zeros((0, model.nq))
    if not along[1].any():
        return ALONG, np.stack([along[0], -along[0]])
    angles = [i * math.pi / 4 for i in range(len(COMPASS))]
    return COMPASS, np.stack([math.cos(a) * along[0] + math.sin(a) * along[1] for a in angles])


def option_reward_names(env: Any) -> tuple[str, ...]:
    """Return the names of the rewards that a task offers to options; "task" is always one."""
    offered: Mapping[str, Any] = {}
    if hasattr(env, "option_rewards"):
        state: Any = jax.eval_shape(env.reset, jax.random.key(0))
        size = env.spec.action.shape if hasattr(env, "spec") else (env.action_size,)
        action = jax.ShapeDtypeStruct(size, jnp.float32)
        offered = jax.eval_shape(env.option_rewards, state, action, state)
    return (*(name for name in offered if name != TASK), TASK)


def check_option_rewards(env: Any, names: tuple[str, ...]) -> None:
    """Check that a task offers the rewards that options are to learn from.

    Raises:
      UsageError: it does not offer one of them.
    """
    known = option_reward_names(env) if set(names) - {TASK, LEARNED} else (TASK,)
    known = (*known, LEARNED)
    for name in names:
        if name not in known:
            raise unknown_name("option reward of this task", name, known)


def option_rewards(
    env: Any, names: tuple[str, ...], before: Any, action: jax.Array, after: Any, reward: jax.Array
) -> jax.Array:
    """Return the named rewards [B, n] of a step of B environments.

    Args:
      env: the task, unbatched.
      names: of the rewards.
      before: the states [B, ...] before the step.
      action: [B, ...].
      after: the states [B, ...] that the step led to, before any reset.
      reward: [B], the task's own.
    """
    paid: dict[str, jax.Array] = {}
    if set(names) - {TASK, LEARNED}:
        paid = jax.vmap(env.option_rewards)(before, action, after)
    paid = paid | {TASK: reward, LEARNED: jnp.zeros_like(reward)}
    return jnp.stack([jnp.asarray(paid[name], jnp.float32) for name in names], axis=-1)
