"""How fast MuJoCo C steps a model on this machine."""

import time

import mujoco
from mujoco.batch import Batch

from hitmdp_jax.machine import available_cores


def native_speed(
    model: mujoco.MjModel, frame_skip: int, num_envs: int = 64, seconds: float = 0.1
) -> float:
    """Measure control steps per second of `num_envs` simulations, without JAX.

    They share every core that the process may use.
    """
    batch = Batch(model, num_envs, nthread=available_cores())
    batch.step(nstep=frame_skip)
    start, calls = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        batch.step(nstep=frame_skip)
        calls += 1
    return calls * num_envs / (time.perf_counter() - start)
