"""What the entries of a task's observations and actions are called in its MuJoCo model."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.envs.base import MujocoEnv, has_model

ORIENTATION = tuple(f"orientation {part}" for part in "wxyz")
ROTATION = tuple(f"{axis} rotation" for axis in "xyz")
POSITIONS = {  # what a joint's coordinates are called, by its kind
    mujoco.mjtJoint.mjJNT_FREE: (*(f"{axis} position" for axis in "xyz"), *ORIENTATION),
    mujoco.mjtJoint.mjJNT_BALL: ORIENTATION,
    mujoco.mjtJoint.mjJNT_SLIDE: ("position",),
    mujoco.mjtJoint.mjJNT_HINGE: ("angle",),
}
VELOCITIES = {
    mujoco.mjtJoint.mjJNT_FREE: (*(f"{axis} velocity" for axis in "xyz"), *ROTATION),
    mujoco.mjtJoint.mjJNT_BALL: ROTATION,
    mujoco.mjtJoint.mjJNT_SLIDE: ("velocity",),
    mujoco.mjtJoint.mjJNT_HINGE: ("velocity",),
}
DRAWS = 3  # of coordinates, by which an entry is recognised
TOLERANCE = 1e-5


class Names(NamedTuple):
    """The names of a task's observations and actions, as many as there are entries."""

    observations: tuple[str, ...]  # "rootz position", "cos(hinge angle)"; else "obs[3]"
    actuators: tuple[str, ...]  # "bthigh"; else "action[2]"


def names_of(env: Env) -> Names:
    """Return the names of a task's entries; numbers where its model, or none at all, tells.

    An observation's entry is recognised by what it does: it is named after the coordinate that it
    shows, or shows the sine or cosine of, whatever the coordinates are. What a task makes of
    several of them, or of forces, keeps its number.
    """
    if not has_model(env):
        return Names(*(_numbered(*x) for x in _sizes(env)))
    coordinates = position_names(env.model) + velocity_names(env.model)
    shown = _shown(env, len(coordinates))
    named = (f"{prefix}{name}{end}" for prefix, end in FORMS for name in coordinates)
    forms = dict(enumerate(named))
    numbers = _numbered("obs", len(shown))
    observations = (forms.get(form, name) for form, name in zip(shown, numbers, strict=True))
    return Names(tuple(observations), actuator_names(env.model))


FORMS = (("", ""), ("cos(", ")"), ("sin(", ")"))


def _shown(env: MujocoEnv, size: int) -> list[int]:
    """Return which form of which coordinate each observation's entry is; -1 if none."""
    blank = jax.eval_shape(env.reset, jax.random.key(0)).pipeline_state
    random = np.random.default_rng(0)
    drawn = jnp.asarray(random.uniform(-1.0, 1.0, (DRAWS, size)), jnp.float32)

    @jax.jit
    def observe(coordinates: jax.Array) -> jax.Array:
        zeros = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), blank)
        qpos, qvel = jnp.split(coordinates, [env.model.nq])
        return env.observation(zeros.replace(qpos=qpos, qvel=qvel))

    seen = np.asarray(jax.vmap(observe)(drawn))
    forms = np.concatenate([drawn, np.cos(drawn), np.sin(drawn)], axis=1)
    equal = (np.abs(seen[:, :, None] - forms[:, None]) < TOLERANCE).all(axis=0)  # [O, forms]
    return np.where(np.any(equal, axis=1), equal.argmax(axis=1), -1).tolist()


def position_names(model: mujoco.MjModel) -> list[str]:
    """Return the names of a model's generalised positions, nq."""
    return [f"{name} {part}" for name, kind in _joints(model) for part in POSITIONS[kind]]


def velocity_names(model: mujoco.MjModel) -> list[str]:
    """Return the names of a model's generalised velocities, nv."""
    return [f"{name} {part}" for name, kind in _joints(model) for part in VELOCITIES[kind]]


def actuator_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of a model's actuators, or of the joints that nameless ones drive."""
    names = []
    for i in range(model.nu):
        name = model.actuator(i).name
        if not name and model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT:
            name = model.joint(model.actuator_trnid[i, 0]).name
        names.append(name or f"action[{i}]")
    return tuple(names)


def _joints(model: mujoco.MjModel) -> list[tuple[str, mujoco.mjtJoint]]:
    """Return the name and the kind of each joint."""
    kinds = map(mujoco.mjtJoint, model.jnt_type)
    return [(model.joint(i).name or f"joint {i}", kind) for i, kind in enumerate(kinds)]


def _sizes(env: Any) -> tuple[tuple[str, int], tuple[str, int]]:
    return ("obs", int(env.observation_size)), ("action", int(env.action_size))


def _numbered(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}[{i}]" for i in range(size))
