"""How fast MuJoCo C steps a model on this machine."""

import time

import mujoco
from mujoco.batch import Batch


def native_speed(
    model: mujoco.MjModel, frame_skip: int, num_envs: int = 64, seconds: float = 0.1
) -> float:
    """Measure control steps a second of `num_envs` simulations on all cores, without JAX."""
    batch = Batch(model, num_envs)
    batch.step(nstep=frame_skip)
    start, calls = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        batch.step(nstep=frame_skip)
        calls += 1
    return calls * num_envs / (time.perf_counter() - start)
