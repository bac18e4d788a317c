"""What the entries of a task's observations and actions are called in its MuJoCo model."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

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
SAMPLES = 3  # of coordinates, by which an entry is recognised
TOLERANCE = 1e-5
FORMS = (("", ""), ("cos(", ")"), ("sin(", ")"))


def observation_names(
    model: mujoco.MjModel, observe: Callable[[jax.Array, jax.Array], jax.Array]
) -> tuple[str, ...]:
    """Return the names of an observation's entries: "rootz position", "cos(hinge angle)", "obs[3]".

    An entry is recognised by what it does: it is named after the coordinate that it shows, or shows
    the sine or cosine of, whatever the coordinates are. What a task makes of several of them, or of
    forces, has its number for a name.

    Args:
      model: the task's.
      observe: maps qpos [nq] and qvel [nv] to an observation [O].
    """
    coordinates = position_names(model) + velocity_names(model)
    random = np.random.default_rng(0)
    drawn = random.uniform(-1.0, 1.0, (SAMPLES, len(coordinates))).astype(np.float32)
    with jax.ensure_compile_time_eval():  # whoever asks first may be in the midst of tracing
        qpos, qvel = jnp.asarray(drawn[:, : model.nq]), jnp.asarray(drawn[:, model.nq :])
        seen = np.asarray(jax.jit(jax.vmap(observe))(qpos, qvel))
    forms = np.concatenate([drawn, np.cos(drawn), np.sin(drawn)], axis=1)
    equal = (np.abs(seen[:, :, None] - forms[:, None]) < TOLERANCE).all(axis=0)  # [O, forms]
    named = [f"{prefix}{name}{end}" for prefix, end in FORMS for name in coordinates]
    known, first = np.any(equal, axis=1), np.argmax(equal, axis=1)
    return tuple(named[first[i]] if known[i] else f"obs[{i}]" for i in range(len(known)))


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
