"""Initial-state distributions that several tasks share."""

import jax
import jax.numpy as jnp
import mujoco


def uniform_around_rest(
    model: mujoco.MjModel, key: jax.Array, scale: float
) -> tuple[jax.Array, jax.Array]:
    """Draw qpos [nq] and qvel [nv] uniformly within `scale` of the model's own pose at rest."""
    noise = jax.random.uniform(key, (model.nq + model.nv,), jnp.float32, -scale, scale)
    return model.qpos0 + noise[: model.nq], noise[model.nq :]


def normal_velocity_around_rest(
    model: mujoco.MjModel, key: jax.Array, scale: float
) -> tuple[jax.Array, jax.Array]:
    """Draw qpos [nq] uniformly within `scale` of the rest pose and qvel [nv] from N(0, scale²)."""
    key_qpos, key_qvel = jax.random.split(key)
    noise = jax.random.uniform(key_qpos, (model.nq,), jnp.float32, -scale, scale)
    return model.qpos0 + noise, scale * jax.random.normal(key_qvel, (model.nv,), jnp.float32)
