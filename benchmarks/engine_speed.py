"""Environment steps per second of both engines, beside their limits and their peers.

`python benchmarks/engine_speed.py` prints a table. `raw` is MuJoCo's own `Batch.step` without JAX,
the limit of `native`; `envpool` goes through EnvPool's XLA interface (`pip install envpool`), which
restarts finished episodes, and so does `native+resets`, through `VectorEnv`; `mjx-full` is `mjx`
with the model's own solver budget; `brax` is Brax's own `mjx` back end. The others go on from
wherever random actions lead. All step 256 environments inside one compiled scan. Each engine has a
process of its own; they take turns, and the table shows each one's median turn, because a machine
is rarely as fast now as a minute ago. Below the row it says why an engine failed, if one did.
`--memory` instead prints the peak memory of stepping 4096 HalfCheetahs.
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
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
from hitmdp_jax.envs.vector import VectorEnv, VectorState
from hitmdp_jax.machine import available_cores
from hitmdp_jax.physics import MjxEngine, PhysicsChoice
from hitmdp_jax.runs.host import set_up_host

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
    """Call for some seconds."""
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


def scan(reset: Callable, step: Callable, controls: Any) -> Callable[[], Any]:
    """Return a compiled scan of a vmapped environment; each call starts from fresh states."""
    num_envs = controls.shape[1]

    @jax.jit
    def run(states: Any):
        return jax.lax.scan(lambda s, a: (jax.vmap(step)(s, a), None), states, controls)[0]

    states = jax.jit(jax.vmap(reset))(jax.random.split(jax.random.key(0), num_envs))
    return lambda: jax.block_until_ready(run(states))


def scan_with_resets(env: MujocoEnv, controls: Any) -> Callable[[], Any]:
    """Return `VectorEnv` scanned, fresh initial states included; a call goes on from the last."""
    num_envs = controls.shape[1]
    vector_env = VectorEnv(env, num_envs, pool_size=SCAN_LENGTH * num_envs // 4)

    @jax.jit
    def run(state: VectorState, key: jax.Array):
        return jax.lax.scan(vector_env.step, vector_env.refill(state, key), controls)

    states = [jax.jit(vector_env.reset)(jax.random.key(0))]

    def call() -> None:
        states[0], step = run(states[0], jax.random.key(1))
        jax.block_until_ready(step.reward)

    return call


def raw_batch(name: str, num_envs: int) -> Callable[[], Any]:
    """Return `Batch.step` from the same states and under the same actions as `native`."""
    env = task(name, "native")
    batch = Batch(env.model, num_envs, nthread=available_cores())
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

    return call


def envpool_scan(name: str, num_envs: int) -> Callable[[], Any]:
    """Return EnvPool's XLA interface scanned; it takes actions in float64."""
    import envpool  # pyright: ignore[reportMissingImports] # a benchmark's dependency only

    jax.config.update("jax_enable_x64", True)
    gym_name = f"{type(task(name, 'native')).__name__}-v4"
    env = envpool.make(
        gym_name, env_type="gymnasium", num_envs=num_envs, num_threads=available_cores()
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

    return call


def prepare(name: str, engine: str, num_envs: int) -> Callable[[], Any]:
    """Return what makes `SCAN_LENGTH` steps of every environment."""
    if engine == "raw":
        return raw_batch(name, num_envs)
    if engine == "envpool":
        return envpool_scan(name, num_envs)
    choices: dict[str, PhysicsChoice] = {
        "native+resets": "native",
        "mjx-full": MjxEngine(full_budget=True),
        "brax": "mjx",
    }
    ours = task(name, choices.get(engine, engine))
    controls = actions(ours, num_envs)
    if engine == "native+resets":
        return scan_with_resets(ours, controls)
    if engine == "brax":
        import brax.envs

        env = brax.envs.get_environment(BRAX_NAMES[name], backend="mjx")
        return scan(env.reset, env.step, controls[..., : env.action_size])
    return scan(ours.reset, ours.step, controls)


def serve(name: str, engine: str, num_envs: int) -> None:
    """Answer every number of seconds on standard input with environment steps per second."""
    by_mjx = engine in ("mjx", "mjx-full", "brax")
    set_up_host("mjx" if by_mjx else engine.removesuffix("+resets"), num_envs)
    call = prepare(name, engine, num_envs)
    call()
    for line in sys.stdin:
        print(calls_per_second(call, float(line)) * SCAN_LENGTH * num_envs, flush=True)


class Worker:
    """`serve` in a process of its own."""

    def __init__(self, *arguments: Any):
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 # `close` closes it
        command = [sys.executable, __file__, "--serve", json.dumps(arguments)]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=self._errors, text=True
        )

    def measure(self, seconds: float) -> float:
        """Return environment steps per second; NaN once the process has failed."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            print(seconds, file=stdin, flush=True)
            return float(stdout.readline() or "nan")
        except BrokenPipeError:
            return math.nan

    def close(self) -> str:
        """End the process; return the last line of its complaint where it failed, else nothing."""
        self._process.communicate()
        with self._errors:
            self._errors.seek(0)
            lines = self._errors.read().split("\n")
        said = [line for line in lines if line.strip()] or ["it says nothing"]
        return said[-1] if self._process.returncode else ""


def main() -> None:
    """Print the table."""
    tasks = [name for name in hitmdp_jax.list_envs() if not name.startswith("toy/")]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", default=list(BRAX_NAMES), choices=tasks)
    parser.add_argument("--engines", nargs="+", default=ENGINES, choices=ENGINES)
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="of a turn")
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--serve", help="be a worker: task, engine and environments, as JSON")
    options = parser.parse_args()
    if options.serve:
        serve(*json.loads(options.serve))
        return
    if options.memory:
        for engine in ("native", "mjx"):
            worker = Worker("halfcheetah", engine, 4096)
            worker.measure(1.0)
            worker.close()
            peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
            print(f"{engine}: peak {peak:.2f} GiB so far")
        return
    print(f"{'task':24}" + "".join(f"{engine:>15}" for engine in options.engines))
    for name in options.tasks:
        workers = [Worker(name, engine, options.num_envs) for engine in options.engines]
        for worker in workers:
            worker.measure(0.1)  # once all have compiled, none disturbs the others
        turns = [[w.measure(options.seconds) for w in workers] for _ in range(options.turns)]
        failures = [worker.close() for worker in workers]
        cells = "".join(f"{speed:15,.0f}" for speed in np.median(turns, axis=0))
        print(f"{name:24}{cells}", flush=True)
        for engine, failure in zip(options.engines, failures, strict=True):
            if failure:
                print(f"  {engine} failed: {failure}", flush=True)


if __name__ == "__main__":
    main()
