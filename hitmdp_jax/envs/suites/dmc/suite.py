"""What the DeepMind Control domains share: their models, initial poses and sensors."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from hitmdp_jax.envs.assets import asset_path, load_model
from hitmdp_jax.envs.suites.dmc import SUITE


def load_suite_model(
    domain: str, edit: Callable[[mujoco.MjSpec], None] | None = None
) -> mujoco.MjModel:
    """Compile a domain's model from dm_control's own files.

    Args:
      domain: the file's name without its suffix, e.g. "cheetah".
      edit: changes the specification before it is compiled.

    Raises:
      UsageError: dm_control is not installed.
    """
    SUITE.check_installed()
    return load_model(asset_path("dm_control", "suite", f"{domain}.xml"), edit)


def random_joint_angles(
    model: mujoco.MjModel, key: jax.Array, turn_unlimited: bool = True
) -> jax.Array:
    """Draw qpos [nq] of a model of hinges and slides, uniformly within the joints' ranges.

    Args:
      model: the compiled model.
      key: the random key.
      turn_unlimited: draw hinges without a range from a whole turn; else they stay as they are,
        as slides without a range do.
    """
    low, high = model.qpos0.copy(), model.qpos0.copy()
    for joint in range(model.njnt):
        address = model.jnt_qposadr[joint]
        if model.jnt_limited[joint]:
            low[address], high[address] = model.jnt_range[joint]
        elif turn_unlimited and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            low[address], high[address] = -math.pi, math.pi
    low, high = np.float32(low), np.float32(high)
    return jax.random.uniform(key, (model.nq,), jnp.float32, minval=low, maxval=high)


def sensor_slice(model: mujoco.MjModel, name: str) -> slice:
    """Return where a sensor's values lie in `sensordata`."""
    sensor = model.sensor(name)
    return slice(int(sensor.adr[0]), int(sensor.adr[0] + sensor.dim[0]))
