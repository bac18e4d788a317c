"""One run from settings to files: the host's side of training."""

import functools
import os
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.agents.base import Metrics
from hitmdp_jax.analysis.figures import draw_figures
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.physics.native import NativePhysics
from hitmdp_jax.envs.physics.speed import native_speed
from hitmdp_jax.training.checkpoint import Checkpoints
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.display import Display
from hitmdp_jax.training.policy import restore
from hitmdp_jax.training.program import make_train
from hitmdp_jax.training.records import Records
from hitmdp_jax.training.sweep import Device, devices_for, place, sweep


def run(config: RunConfig, run_dir: Path, resume: bool = False) -> None:
    """Train as `config` says and leave everything in `run_dir`.

    The device is always one iteration ahead of the host: while metrics are written and shown, the
    next iteration runs already. Ctrl-C ends the run after the iteration in progress, saved like a
    finished one.

    Args:
      config: validated settings.
      run_dir: the run's folder, made if need be.
      resume: continue from the folder's newest checkpoint.
    """
    devices = devices_for(config.seeds)
    agent = config.make_agent()
    env = make_task(config, len(devices))
    init, step = sweep(
        *make_train(
            agent,
            env,
            num_steps=config.total_steps,
            num_envs=config.num_envs,
            rollout_length=config.rollout_length,
        ),
        devices,
    )
    if resume:
        first, state = restore(run_dir, config, agent)
        state = place(state, devices)
    else:
        first, state = 0, init(place(seed_keys(config), devices))
        run_dir.mkdir(parents=True, exist_ok=True)
    config.save(run_dir / "config.yaml")

    per_iteration = config.steps_per_iteration
    last = config.iterations
    checkpoint_every = max(1, config.checkpoint_steps // per_iteration)
    with ExitStack() as stack:
        checkpoints = Checkpoints(run_dir)
        stack.callback(checkpoints.close)
        records = Records(run_dir, config.seed, resume_after=first)
        stack.callback(records.close)
        display = stack.enter_context(
            Display(title(config, env, devices), last * per_iteration, first * per_iteration)
        )
        interrupted = stack.enter_context(interruptible())
        clock = time.perf_counter()

        def report(iteration: int, metrics: Metrics) -> None:
            nonlocal clock
            values = {name: np.asarray(x) for name, x in metrics.items()}  # waits for the device
            elapsed, clock = time.perf_counter() - clock, time.perf_counter()
            values["steps_per_second"] = np.full(config.seeds, per_iteration / elapsed)
            records.write(iteration, iteration * per_iteration, values)
            display.update(iteration * per_iteration, values)

        pending = None
        iteration = first
        while iteration < last and not interrupted():
            state, metrics = step(state)
            iteration += 1
            if pending:
                report(*pending)
            pending = iteration, metrics
            if iteration % checkpoint_every == 0:
                checkpoints.save(iteration, state)
        if pending:
            report(*pending)
        checkpoints.save(iteration, state)
        early = interrupted()
    draw_figures(run_dir, f"{config.algo['name']} on {config.env['name']}")
    where = f"Stopped at {iteration * per_iteration:,} env steps, saved" if early else "Saved"
    display.message(f"{where} in {run_dir}.")


def make_task(config: RunConfig, num_devices: int) -> Env:
    """Make the run's environment; native physics shares the cores out among the devices."""
    physics = config.physics
    if physics == "native":
        threads = max(1, (os.cpu_count() or 1) // num_devices)
        physics = functools.partial(NativePhysics, num_threads=threads)
    return make_env(**config.env, physics=physics)


def seed_keys(config: RunConfig) -> jax.Array:
    """Return the seeds' keys [S]: seed i gets the same whether it runs alone or among others."""
    return jax.vmap(jax.random.key)(config.seed + jnp.arange(config.seeds))


def title(config: RunConfig, env: Env, devices: list[Device]) -> str:
    """Return the line that says what runs, and where something would be faster."""
    kind = devices[0].device_kind if devices[0].platform != "cpu" else "CPU"
    parts = [
        f"{config.algo['name']} on {config.env['name']}",
        f"physics {env.backend} on {len(devices)} × {kind}",
        f"{config.num_envs} envs × {config.seeds} seeds",
    ]
    if isinstance(env, MujocoEnv) and env.backend == "mjx" and devices[0].platform == "cpu":
        speed = native_speed(env.model, env.physics.frame_skip)
        parts.append(f"physics=native would step {speed:,.0f} envs a second here")
    return ", ".join(parts)


@contextmanager
def interruptible() -> Iterator:
    """Turn the first Ctrl-C into a request to stop, yielded as a function; a second one kills."""
    requested = False

    def request(signum: int, frame: object) -> None:
        nonlocal requested
        requested = True
        signal.signal(signal.SIGINT, previous)

    previous = signal.signal(signal.SIGINT, request)
    try:
        yield lambda: requested
    finally:
        signal.signal(signal.SIGINT, previous)
