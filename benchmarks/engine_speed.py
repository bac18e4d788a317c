"""Environment steps a second of both engines, beside their limits and their peers.

`python benchmarks/engine_speed.py` prints a table. `raw` is MuJoCo's own `Batch.step` without JAX,
the limit of `native`; `envpool` goes through EnvPool's XLA interface (`pip install envpool`), which
restarts finished episodes, and so does `native+resets`, through `VectorEnv`; `mjx-full` is `mjx`
with the model's own solver budget; `brax` is Brax's own `mjx` back end. The others go on from
wherever random actions lead. All step 256 environments inside one compiled scan, each in a process
of its own. `--memory` instead prints the peak memory of stepping 4096 HalfCheetahs.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco.batch import Batch

import hitmdp_jax
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.physics import PhysicsChoice
from hitmdp_jax.envs.physics.mjx import MjxPhysics
from hitmdp_jax.envs.wrappers import VectorEnv, VectorState

ENGINES = ("raw", "native", "native+resets", "envpool", "mjx", "mjx-full", "brax")
SCAN_LENGTH = 32
BRAX_NAMES = {
    "halfcheetah": "halfcheetah",
    "swimmer": "swimmer",
    "humanoidstandup": "humanoidstandup",
    "reacher": "reacher",
    "walker2d": "walker2d",
    "hopper": "hopper",
    "invertedpendulum": "inverted_pendulum",
    "inverteddoublependulum": "inverted_double_pendulum",
    "ant": "ant",
    "humanoid": "humanoid",
}


def calls_per_second(call: Callable[[], Any], seconds: float) -> float:
    """Call for some seconds after one call that compiles."""
    call()
    start, calls = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        call()
        calls += 1
    return calls / (time.perf_counter() - start)


def task(name: str, physics: PhysicsChoice) -> MujocoEnv:
    """Make a MuJoCo task."""
    env = hitmdp_jax.make_env(name, physics=physics)
    assert isinstance(env, MujocoEnv)
    return env


def actions(env: MujocoEnv, num_envs: int) -> np.ndarray:
    """Draw random actions [T, B, A]."""
    low, high = env.model.actuator_ctrlrange.T
    size = (SCAN_LENGTH, num_envs, len(low))
    return np.random.default_rng(0).uniform(low, high, size).astype(np.float32)


def scan_speed(reset: Callable, step: Callable, controls: Any, seconds: float) -> float:
    """Time a compiled scan of a vmapped environment; each call starts from fresh states."""
    num_envs = controls.shape[1]

    @jax.jit
    def run(states: Any):
        return jax.lax.scan(lambda s, a: (jax.vmap(step)(s, a), None), states, controls)[0]

    states = jax.jit(jax.vmap(reset))(jax.random.split(jax.random.key(0), num_envs))
    speed = calls_per_second(lambda: jax.block_until_ready(run(states)), seconds)
    return speed * SCAN_LENGTH * num_envs


def speed_with_resets(env: MujocoEnv, controls: Any, seconds: float) -> float:
    """Time `VectorEnv`, fresh initial states included; each call goes on from the last one."""
    num_envs = controls.shape[1]
    vector_env = VectorEnv(env, num_envs, pool_size=SCAN_LENGTH * num_envs // 4)

    @jax.jit
    def run(state: VectorState, key: jax.Array):
        return jax.lax.scan(vector_env.step, vector_env.refill(state, key), controls)

    states = [jax.jit(vector_env.reset)(jax.random.key(0))]

    def call() -> None:
        states[0], step = run(states[0], jax.random.key(1))
        jax.block_until_ready(step.reward)

    return calls_per_second(call, seconds) * SCAN_LENGTH * num_envs


def raw_speed(name: str, num_envs: int, seconds: float) -> float:
    """Time `Batch.step` from the same states and under the same actions as `native`."""
    env = task(name, "native")
    batch = Batch(env.model, num_envs)
    # DeepMind Control reads fields at the state after the step.
    stage = mujoco.mjtStage.mjSTAGE_VEL if name.startswith("dmc/") else mujoco.mjtStage.mjSTAGE_NONE
    keys = jax.random.split(jax.random.key(0), num_envs)
    qpos, qvel = jax.vmap(env.sample_initial)(keys)
    controls = actions(env, num_envs)

    def call() -> None:
        batch.qpos[:], batch.qvel[:], batch.qacc_warmstart[:] = qpos, qvel, 0.0
        for control in controls:
            batch.ctrl[:] = control
            batch.step(nstep=env.physics.frame_skip, stage=stage)

    return calls_per_second(call, seconds) * SCAN_LENGTH * num_envs


def envpool_speed(name: str, num_envs: int, seconds: float) -> float:
    """Time EnvPool's XLA interface, which takes actions in float64."""
    import envpool  # pyright: ignore[reportMissingImports] # a benchmark's dependency only

    jax.config.update("jax_enable_x64", True)
    gym_name = f"{type(task(name, 'native')).__name__}-v4"
    env = envpool.make(
        gym_name, env_type="gymnasium", num_envs=num_envs, num_threads=os.cpu_count()
    )
    handle, _, _, step = env.xla()
    env.reset()
    controls = jnp.asarray(actions(task(name, "native"), num_envs), jnp.float64)

    @jax.jit
    def run(handle: Any):
        def body(handle: Any, action: jax.Array):
            handle, (_, reward, *_) = step(handle, action)
            return handle, reward

        return jax.lax.scan(body, handle, controls)

    state = [handle]

    def call() -> None:
        state[0], reward = run(state[0])
        jax.block_until_ready(reward)

    return calls_per_second(call, seconds) * SCAN_LENGTH * num_envs


def measure(name: str, engine: str, num_envs: int, seconds: float) -> float:
    """Return environment steps a second."""
    if engine == "raw":
        return raw_speed(name, num_envs, seconds)
    if engine == "envpool":
        return envpool_speed(name, num_envs, seconds)
    choices: dict[str, PhysicsChoice] = {"native+resets": "native", "mjx-full": MjxPhysics}
    ours = task(name, choices.get(engine, "mjx" if engine == "brax" else engine))
    controls = actions(ours, num_envs)
    if engine == "native+resets":
        return speed_with_resets(ours, controls, seconds)
    if engine == "brax":
        import brax.envs

        env = brax.envs.get_environment(BRAX_NAMES[name], backend="mjx")
        return scan_speed(env.reset, env.step, controls[..., : env.action_size], seconds)
    return scan_speed(ours.reset, ours.step, controls, seconds)


def in_own_process(*arguments: Any) -> Any:
    """Run this file on one measurement; None where it fails."""
    command = [sys.executable, __file__, "--one", json.dumps(arguments)]
    out = subprocess.run(command, capture_output=True, text=True)
    return json.loads(out.stdout.splitlines()[-1]) if out.returncode == 0 else None


def main() -> None:
    """Print the table."""
    tasks = [name for name in hitmdp_jax.list_envs() if not name.startswith("toy/")]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", default=list(BRAX_NAMES), choices=tasks)
    parser.add_argument("--engines", nargs="+", default=ENGINES, choices=ENGINES)
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--one", help="one measurement, as JSON")
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(*json.loads(options.one))))
        return
    if options.memory:
        for engine in ("native", "mjx"):
            in_own_process("halfcheetah", engine, 4096, 1.0)
            peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
            print(f"{engine}: peak {peak:.2f} GiB so far")
        return
    print(f"{'task':24}" + "".join(f"{engine:>15}" for engine in options.engines))
    for name in options.tasks:
        speeds = [
            in_own_process(name, engine, options.num_envs, options.seconds)
            for engine in options.engines
        ]
        cells = "".join(f"{speed:15,.0f}" if speed else f"{'-':>15}" for speed in speeds)
        print(f"{name:24}{cells}", flush=True)


if __name__ == "__main__":
    main()
