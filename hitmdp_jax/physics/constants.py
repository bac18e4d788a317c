"""What MuJoCo derives from a model's masses before it simulates, for a model that MJX draws."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx


def constants_of(model: mujoco.MjModel, drawn: mjx.Model) -> dict[str, jax.Array]:
    """Return the fields that `mj_setConst` would derive from a drawn model's masses.

    They are the weights with which constraints act on joints and bodies: entries of the inverse of
    the inertia in the model's own pose, of a joint its mean along one kind of axis, of a body those
    of its centre of mass. Of tendons they stay as they are.

    Args:
      model: of which the drawn one has all but its numbers.
      drawn: the model as MJX has it.
    """
    data = mjx.make_data(drawn).replace(qpos=drawn.qpos0)
    for stage in (mjx.kinematics, mjx.com_pos, mjx.crb):
        data = stage(drawn, data)
    inverse = jnp.linalg.inv(mjx.full_m(drawn, data))
    bodies = jnp.arange(model.nbody)
    jacobians = jax.vmap(lambda place, body: mjx.jac(drawn, data, place, body))(data.xipos, bodies)
    of_bodies = [jnp.einsum("bia,ij,bja->b", x, inverse, x) / 3 for x in jacobians]
    moves = jnp.asarray(model.body_weldid != 0)
    return {
        "dof_invweight0": _alike(model) @ jnp.diagonal(inverse),
        "body_invweight0": jnp.where(moves[:, None], jnp.stack(of_bodies, axis=1), 0.0),
        "body_subtreemass": _descent(model) @ drawn.body_mass,
    }


def _alike(model: mujoco.MjModel) -> np.ndarray:
    """Return what takes means over the degrees of freedom of one kind of a joint, [nv, nv]."""
    first_of_kind = np.arange(model.nv)
    for joint, first in zip(model.jnt_type, model.jnt_dofadr, strict=True):
        if joint == mujoco.mjtJoint.mjJNT_FREE:
            first_of_kind[first : first + 6] = [first] * 3 + [first + 3] * 3
        elif joint == mujoco.mjtJoint.mjJNT_BALL:
            first_of_kind[first : first + 3] = first
    same = (first_of_kind[:, None] == first_of_kind).astype(np.float32)
    return same / same.sum(axis=1, keepdims=True)


def _descent(model: mujoco.MjModel) -> np.ndarray:
    """Return what adds up bodies and all that hang on them, [nbody, nbody]."""
    below = np.eye(model.nbody, dtype=np.float32)
    for body in range(model.nbody - 1, 0, -1):
        below[model.body_parentid[body]] += below[body]
    return below
