"""What an accelerator makes of it: `python -m benchmarks.gpu` (extra `warp` for its rows).

Environment steps per second of the physics alone, whole trainings of one seed and of many with the
time to their first update, Brax's PPO on the same card, on its task and on ours, and whether the
same seed gives the same run. Each row runs in a process of its own, on the first card, or on
whatever device JAX finds: small sizes try it on a CPU. `--lacking` measures the rows that
docs/benchmarks.md lacks, each once: they are meant to take less than twelve minutes.
"""

import argparse
import dataclasses
import hashlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp

import hitmdp_jax
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.host import set_up_host
from hitmdp_jax.runs.run import Run

BRAX = {"invertedpendulum": "inverted_pendulum"}  # tasks that Brax names otherwise
ENVS = (1024, 2048, 4096, 8192, 16384, 32768)
SEEDS = (1, 10, 100)
OFF_POLICY = ("sac", "hit_sac")  # trained in the sizes of their own preset
SUITES = ("gymnax/Breakout-MinAtar", "xminigrid/MiniGrid-DoorKey-8x8")
DETERMINISM = "--xla_gpu_deterministic_ops=true"  # of XLA; it says nothing to other devices

Figures = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Size:
    """A training's size: environments of each seed, steps per update, samples per minibatch."""

    num_envs: int
    rollout_length: int
    minibatch_size: int

    def settings(self, env: str, algo: str, physics: str, seeds: int) -> list[str]:
        """Return the settings of a run of ours."""
        task = [f"env={env}", f"algo={algo}"]
        if algo in OFF_POLICY:
            return [*task, "preset=off_policy_gpu", f"physics={physics}", f"seeds={seeds}"]
        sizes = (f"num_envs={self.num_envs}", f"rollout_length={self.rollout_length}")
        minibatch = f"algo.minibatch_size={self.minibatch_size}"
        return [
            *task,
            f"physics={physics}",
            f"seeds={seeds}",
            *sizes,
            minibatch,
        ]


def per_call(function: Callable[..., Any], argument: Any, seconds: float) -> float:
    """Return the seconds that a compiled step takes, each on what the one before returned."""
    start, calls = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        argument = jax.block_until_ready(function(argument))
        calls += 1
    return (time.perf_counter() - start) / calls


def env_steps(name: str, physics: str, num_envs: int, seconds: float, length: int = 16) -> Figures:
    """Time random actions in environments side by side, without resets."""
    env = hitmdp_jax.make_env(name, physics=physics)

    @jax.jit
    def steps(carry):
        def step(carry, _):
            state, key = carry
            key, key_action = jax.random.split(key)
            action = jax.random.uniform(key_action, (num_envs, env.action_size), minval=-1.0)
            return (jax.vmap(env.step)(state, action), key), None

        return jax.lax.scan(step, carry, length=length)[0]

    keys = jax.random.split(jax.random.key(0), num_envs)
    start = time.perf_counter()
    carry = jax.jit(jax.vmap(env.reset))(keys), jax.random.key(1)
    carry = jax.block_until_ready(steps(carry))
    compiled = time.perf_counter() - start
    return {
        "steps_per_second": num_envs * length / per_call(steps, carry, seconds),
        "first_update_s": compiled,
    }


def training(env: str, algo: str, physics: str, seeds: int, size: Size, seconds: float) -> Figures:
    """Time whole iterations, once learning has begun; all seeds are one program on one device."""
    start = time.perf_counter()
    run, step, state = _begun(env, algo, physics, seeds, size)
    state = jax.block_until_ready(step(state)[0])
    first = time.perf_counter() - start
    warmup = run.config.algo.get("warmup_steps", 0)  # of an algorithm with a replay
    for _ in range(warmup // run.schedule.steps_per_report):
        state, _ = step(state)
    steps = run.schedule.steps_per_report * seeds
    return {
        "steps_per_second": steps / per_call(lambda s: step(s)[0], state, seconds),
        "first_update_s": first,
    }


def _begun(env: str, algo: str, physics: str, seeds: int, size: Size) -> tuple[Run, Any, Any]:
    run = Run.create(Settings(size.settings(env, algo, physics, seeds)).config())
    init, step = run.programs(0)
    return run, step, run.begin(0, Progress(0, 0, None), init)


def learned(
    env: str, algo: str, physics: str, seeds: int, size: Size, iterations: int = 3
) -> Figures:
    """Train; return what tells the parameters apart to the last bit."""
    _, step, state = _begun(env, algo, physics, seeds, size)
    for _ in range(iterations):
        state, _ = step(state)
    content = b"".join(x.tobytes() for x in jax.device_get(jax.tree.leaves(state.learner.params)))
    return {"learned": hashlib.sha256(content).hexdigest()}


def brax_ppo(env: str, owner: str, size: Size, seconds: float) -> Figures:
    """Train Brax's PPO with MJX and the same batch and epochs.

    Args:
      env: the task.
      owner: "Brax" for its own task of that name, "ours" for ours.
      size: of the batch.
      seconds: more updates are timed where there are more.
    """
    from brax import envs
    from brax.training.agents.ppo import train as ppo

    if not hasattr(jax, "device_put_replicated"):  # gone from jax 0.10; Brax 0.14 calls it
        jax.device_put_replicated = lambda tree, devices: jax.tree.map(  # pyright: ignore
            lambda x: jnp.stack([x] * len(devices)), tree
        )
    start, reports = time.perf_counter(), []
    samples = size.num_envs * size.rollout_length

    def progress(env_steps: int, metrics: Mapping[str, Any]) -> None:
        reports.append((time.perf_counter(), metrics))

    epochs, updates = 4, max(1, round(seconds))  # it reports after each epoch, of so many updates
    theirs = owner == "Brax"
    ppo.train(
        envs.get_environment(BRAX.get(env, env), backend="mjx")
        if theirs
        else hitmdp_jax.make_env(env, physics="mjx"),
        num_timesteps=epochs * updates * samples,
        num_evals=epochs + 1,
        run_evals=False,
        num_envs=size.num_envs,
        unroll_length=size.rollout_length,
        batch_size=max(1, size.minibatch_size // size.rollout_length),
        num_minibatches=max(1, samples // size.minibatch_size),
        num_updates_per_batch=10,
        episode_length=1000,
        normalize_observations=True,
        progress_fn=progress,
    )
    return {
        "steps_per_second": float(reports[-1][1]["training/sps"]),
        "first_update_s": reports[0][0] - start,
    }


def rows(options: argparse.Namespace) -> dict[str, list[Any]]:
    """Return what is measured: the row's name -> a function's name and its arguments."""
    size = [options.num_envs, options.rollout_length, options.minibatch_size]
    found: dict[str, list[Any]] = {}
    for physics in options.physics:
        for number in options.envs:
            name = f"{physics}, {number:,} environments, physics alone"
            found[name] = ["env_steps", options.env, physics, number]
    for physics in options.physics:
        for algo in options.algos:
            for seeds in options.seeds:
                name = f"{algo} on {physics}, {seeds} seeds x {options.num_envs:,} environments"
                found[name] = ["training", options.env, algo, physics, seeds, *size]
    for owner, task in {"Brax": "its own task", "ours": "our task"}.items():
        name = f"Brax PPO on mjx, {task}, {options.num_envs:,} environments"
        found[name] = ["brax_ppo", options.env, owner, *size]
    name = "the same seed in two processes, deterministic"
    found[name] = ["learned", options.env, options.algos[0], options.physics[0], 1, *size]
    return found


def lacking(options: argparse.Namespace) -> dict[str, list[Any]]:
    """Return the rows, as `rows` does, that docs/benchmarks.md lacks."""
    size = [options.num_envs, options.rollout_length, options.minibatch_size]
    found = {name: row for name, row in rows(options).items() if row[0] == "brax_ppo"}
    for physics in options.physics:
        found[f"{physics}, ant, {options.num_envs:,} environments, physics alone"] = [
            "env_steps", "ant", physics, options.num_envs
        ]  # fmt: skip
        found[f"ppo on ant, {physics}, 1 seed x {options.num_envs:,} environments"] = [
            "training", "ant", "ppo", physics, 1, *size
        ]  # fmt: skip
    for algo in OFF_POLICY:
        name = f"{algo} on mjx, preset=off_policy_gpu, {options.seeds[-1]} seeds"
        found[name] = ["training", options.env, algo, "mjx", options.seeds[-1], *size]
    for task in SUITES:
        for algo in options.algos:
            name = f"{algo} on {task}, 10 seeds x {options.num_envs:,} environments"
            found[name] = ["training", task, algo, "mjx", 10, *size]
    return found


def measure(kind: str, arguments: list[Any], seconds: float) -> Figures:
    """Measure one row in this process."""
    if kind == "env_steps":
        env, physics, num_envs = arguments
        set_up_host(physics, num_envs)
        return env_steps(env, physics, num_envs, seconds)
    env, *how, num_envs, length, minibatch = arguments
    size = Size(num_envs, length, minibatch)
    if kind == "brax_ppo":
        set_up_host("mjx", num_envs)
        (owner,) = how
        return brax_ppo(env, owner, size, seconds)
    algo, physics, seeds = how
    set_up_host(physics, num_envs)
    if kind == "learned":
        return learned(env, algo, physics, seeds, size)
    return training(env, algo, physics, seeds, size, seconds)


def in_own_process(row: list[Any], seconds: float, cache: str) -> Figures | None:
    """Measure a row as a fresh process sees it; None where it fails, which is told."""
    environment = {"CUDA_VISIBLE_DEVICES": "0"} | os.environ  # one card
    environment |= {"JAX_COMPILATION_CACHE_DIR": cache}
    if row[0] == "learned":
        flags = f"{os.environ.get('XLA_FLAGS', '')} {DETERMINISM}"
        environment |= {"XLA_FLAGS": flags.strip()}
    command = [sys.executable, "-m", "benchmarks.gpu", "--row", json.dumps(row)]
    command += ["--seconds", str(seconds)]
    out = subprocess.run(command, capture_output=True, text=True, env=environment)
    if out.returncode:
        print(f"{row}: {(out.stderr.splitlines() or ['failed'])[-1]}", file=sys.stderr)
        return None
    return json.loads(out.stdout.splitlines()[-1])


def main() -> None:
    """Print the table, or one row of it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each figure")
    parser.add_argument("--env", default="halfcheetah", help="the task")
    parser.add_argument("--envs", type=int, nargs="*", default=ENVS, help="of the physics alone")
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS, help="trained side by side")
    engines = ["mjx", *(["warp"] if importlib.util.find_spec("warp") else [])]
    parser.add_argument("--physics", nargs="+", default=engines, help="engines; native is another")
    parser.add_argument("--algos", nargs="+", default=["mopg", "ppo"], help="that are trained")
    parser.add_argument("--num-envs", type=int, default=1024, help="of each seed in training")
    parser.add_argument("--rollout-length", type=int, default=32, help="steps between two updates")
    parser.add_argument("--minibatch-size", type=int, default=2048, help="samples a gradient step")
    parser.add_argument("--lacking", action="store_true", help="the rows that the docs lack, once")
    parser.add_argument("--row", help="measure one row in this process, as JSON")
    options = parser.parse_args()
    if options.row:
        kind, *arguments = json.loads(options.row)
        figures = measure(kind, arguments, options.seconds)
        print(json.dumps(figures | {"device": jax.devices()[0].device_kind}))
        return
    print(
        "| | env steps/s | first update, cold / warm cache (s) | device |\n"
        "| --- | --- | --- | --- |"
    )
    with tempfile.TemporaryDirectory() as cache:
        for name, row in (lacking if options.lacking else rows)(options).items():
            cold = in_own_process(row, options.seconds if options.lacking else 0.1, cache)
            again = cold and not options.lacking
            warm = in_own_process(row, options.seconds, cache) if again else cold
            if warm is None or cold is None:
                print(f"| {name} | failed | | |", flush=True)
            elif "learned" in warm:
                both = cold["learned"] == warm["learned"]
                print(f"| {name} | {'equal' if both else 'NOT equal'} | | {warm['device']} |")
            else:
                starts = f"{cold['first_update_s']:.0f}"
                starts += "" if options.lacking else f" / {warm['first_update_s']:.0f}"
                speed = f"{warm['steps_per_second']:,.0f}"
                print(f"| {name} | {speed} | {starts} | {warm['device']} |", flush=True)


if __name__ == "__main__":
    main()
