"""One run from settings to files: the host's side of training."""

import functools
import os
import signal
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.agents import Agent
from hitmdp_jax.analysis.figures import draw_figures
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.physics.native import NativePhysics
from hitmdp_jax.envs.physics.speed import native_speed
from hitmdp_jax.learning.metrics import Metrics
from hitmdp_jax.training.checkpoint import Checkpoints
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.display import Display
from hitmdp_jax.training.policy import restore
from hitmdp_jax.training.program import Init, Iterate, make_train, repeat, transfer
from hitmdp_jax.training.records import Records
from hitmdp_jax.training.sweep import Device, devices_for, place, sweep

SPEED_WINDOW = 11  # reports whose times make up the speed shown


def run(config: RunConfig, run_dir: Path, resume: bool = False) -> None:
    """Train as `config` says and leave everything in `run_dir`.

    The device is always one iteration ahead of the host: while metrics are written and shown, the
    next iteration runs already. A transfer trains on its second task where the first ended. Ctrl-C
    ends the run after the iteration in progress, saved like a finished one.

    Args:
      config: validated settings.
      run_dir: the run's folder, made if need be.
      resume: continue from the folder's newest checkpoint.
    """
    devices = devices_for(config.seeds)
    agent = config.make_agent()
    envs = [make_task(config, task, len(devices)) for task in config.tasks]
    first, state = restore(run_dir, config, agent) if resume else (0, None)
    run_dir.mkdir(parents=True, exist_ok=True)
    config.save(run_dir / "config.yaml")

    per_report = config.iterations_per_report
    steps_per_report = per_report * config.steps_per_iteration
    checkpoint_every = max(1, config.checkpoint_steps // steps_per_report) * per_report
    total_steps = config.iterations * len(config.tasks) * config.steps_per_iteration
    iteration = first
    with ExitStack() as stack:
        checkpoints = Checkpoints(run_dir)
        stack.callback(checkpoints.close)
        records = Records(run_dir, config.seed, resume_after=first)
        stack.callback(records.close)
        display = stack.enter_context(
            Display(
                title(config, envs[0], devices), total_steps, first * config.steps_per_iteration
            )
        )
        interrupted = stack.enter_context(interruptible())
        # Single reports come in bunches where the device runs ahead; a window's speed is steady.
        times = deque([time.perf_counter()], maxlen=SPEED_WINDOW)

        def report(iteration: int, metrics: Metrics) -> None:
            values = {name: np.asarray(x) for name, x in metrics.items()}  # waits for the device
            times.append(time.perf_counter())
            speed = steps_per_report * (len(times) - 1) / (times[-1] - times[0])
            values["steps_per_second"] = np.full(config.seeds, speed)
            env_steps = iteration * config.steps_per_iteration
            records.write(iteration, env_steps, values)
            display.update(env_steps, values)

        for number, env in enumerate(envs):
            last = (number + 1) * config.iterations
            if iteration >= last and number + 1 < len(envs):
                continue  # a resumed transfer that has left this task behind
            init, step = programs(config, agent, env, devices)
            if state is None:
                state = init(place(seed_keys(config), devices))
            elif iteration == number * config.iterations:
                state = transfer(state, init(state.key))
            else:
                state = place(state, devices)

            pending = None
            while iteration < last and not interrupted():
                state, metrics = step(state)
                iteration += per_report
                if pending:
                    report(*pending)
                pending = iteration, metrics
                if iteration % checkpoint_every == 0:
                    checkpoints.save(iteration, state)
            if pending:
                report(*pending)
        assert state is not None
        checkpoints.save(iteration, state)
        early = interrupted()
    draw_figures(run_dir, config.title, config.switch_at)
    reached = iteration * config.steps_per_iteration
    where = f"Stopped at {reached:,} env steps, saved" if early else "Saved"
    display.message(f"{where} in {run_dir}.")


def programs(
    config: RunConfig, agent: Agent, env: Env, devices: list[Device]
) -> tuple[Init, Iterate]:
    """Compile-ready init and step of every seed on one task; a step is one report's iterations."""
    init, step = make_train(
        agent,
        env,
        num_steps=config.total_steps,
        num_envs=config.num_envs,
        rollout_length=config.rollout_length,
    )
    return sweep(init, repeat(step, config.iterations_per_report), devices)


def make_task(config: RunConfig, task: dict[str, Any], num_devices: int) -> Env:
    """Make an environment of the run; native physics shares the cores out among the devices."""
    physics = config.physics
    if physics == "native":
        threads = max(1, (os.cpu_count() or 1) // num_devices)
        physics = functools.partial(NativePhysics, num_threads=threads)
    return make_env(**task, physics=physics)


def seed_keys(config: RunConfig) -> jax.Array:
    """Return the seeds' keys [S]: seed i gets the same whether it runs alone or among others."""
    return jax.vmap(jax.random.key)(config.seed + jnp.arange(config.seeds))


def title(config: RunConfig, env: Env, devices: list[Device]) -> str:
    """Return the line that says what runs, and where something would be faster."""
    on_cpu = devices[0].platform == "cpu"
    parts = [
        config.title,
        f"physics {env.backend} on {len(devices)} × {'CPU' if on_cpu else devices[0].device_kind}",
        f"{config.num_envs} envs × {config.seeds} seeds",
    ]
    if isinstance(env, MujocoEnv) and env.backend == "mjx" and on_cpu:
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
