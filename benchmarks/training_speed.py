"""End-to-end training speed, start-up time and where an iteration's time goes.

`python benchmarks/training_speed.py` prints one table; each row runs in a process of its own.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax

from hitmdp_jax.agents import Agent
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.learning.rollout import collect
from hitmdp_jax.physics.speed import native_speed
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.devices import spread
from hitmdp_jax.runs.host import set_up_host
from hitmdp_jax.runs.run import Run

ROWS = (  # algo, physics, seeds
    ("mopg", "native", 1),
    ("mopg", "native", 4),
    ("mopg", "native", 10),
    ("ppo", "native", 1),
    ("ppo", "native", 10),
    ("mopg", "mjx", 1),
    ("dac", "native", 1),
    ("ahp", "native", 1),
    ("ppoc", "native", 1),
    ("iopg", "native", 1),
    ("oc", "native", 1),
)


def settings(algo: str, physics: str, seeds: int) -> RunConfig:
    """Return the default settings of a HalfCheetah run."""
    overrides = ["env=halfcheetah", f"algo={algo}", f"physics={physics}", f"seeds={seeds}"]
    return Settings(overrides).config()


def measure(algo: str, physics: str, seeds: int, seconds: float) -> dict[str, float]:
    """Time whole iterations, then rollout and update apart, of one configuration."""
    config = settings(algo, physics, seeds)
    run = Run.create(config)
    env, agent = run.envs[0], run.agent
    init, step = run.programs(0)

    start = time.perf_counter()
    state = run.begin(0, Progress(0, 0, None), init)
    state, _ = jax.block_until_ready(step(state))
    first = time.perf_counter() - start

    def per_call(function, *arguments) -> float:
        jax.block_until_ready(function(*arguments))
        start, calls = time.perf_counter(), 0
        while time.perf_counter() - start < seconds:
            jax.block_until_ready(function(*arguments))
            calls += 1
        return (time.perf_counter() - start) / calls

    iteration = per_call(step, state)
    rollout = per_call(spread(*rollout_program(agent, env, config), run.mesh)[1], state)
    steps = config.schedule.steps_per_report * seeds
    bare = native_speed(env.model, env.physics.frame_skip)  # pyright: ignore
    return {
        "steps_per_second": steps / iteration,
        "first_iteration_s": first,
        "rollout_share": rollout / iteration,
        "physics_share": steps / bare / iteration if physics == "native" else float("nan"),
    }


def rollout_program(agent: Agent, env: Any, config: RunConfig) -> tuple[Any, Any]:
    """Return a program whose step is the rollouts of a report alone."""
    vector_env = VectorEnv(env, config.num_envs, config.schedule.steps_per_iteration // 4)

    def step(state):
        def once(rollout, key):
            params, length = state.learner.params, config.rollout_length
            rollout = rollout.replace(env=vector_env.refill(rollout.env, key))
            out = collect(agent, params, state.normalizer, vector_env, rollout, key, length)
            return out[0], out[1]

        keys = jax.random.split(state.key, config.schedule.iterations_per_report)
        return jax.lax.scan(once, state.rollout, keys)

    return lambda key: key, step


def in_own_process(row: tuple[str, str, int], seconds: float, cache: str) -> dict[str, float]:
    """Measure a row as a fresh process sees it."""
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": cache}
    arguments = [sys.executable, __file__, "--row", json.dumps(row), "--seconds", str(seconds)]
    out = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=True)
    return json.loads(out.stdout.splitlines()[-1])


def import_seconds() -> float:
    """Time `import hitmdp_jax` in a fresh process."""
    code = "import time; t = time.perf_counter(); import hitmdp_jax; print(time.perf_counter() - t)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(out.stdout)


def main() -> None:
    """Print the table, or one row of it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="time spent on each figure")
    parser.add_argument("--algos", nargs="+", help="only these")
    parser.add_argument("--row", help="measure one row in this process: algo, physics, seeds")
    options = parser.parse_args()
    if options.row:
        algo, physics, seeds = json.loads(options.row)
        set_up_host(physics, num_envs=16, trainings=seeds)
        print(json.dumps(measure(algo, physics, seeds, options.seconds)))
        return
    print(f"import hitmdp_jax: {import_seconds():.1f} s")
    print(
        "algo  physics seeds  env steps/s  first iteration cold / warm (s)  rollout  bare physics"
    )
    with tempfile.TemporaryDirectory() as cache:
        for row in [r for r in ROWS if options.algos is None or r[0] in options.algos]:
            cold = in_own_process(row, 0.1, str(Path(cache)))
            warm = in_own_process(row, options.seconds, str(Path(cache)))
            share = warm["physics_share"]
            bare = f"{share:.0%}" if share == share else "-"
            print(
                f"{row[0]:5} {row[1]:7} {row[2]:5}  {warm['steps_per_second']:11,.0f}  "
                f"{cold['first_iteration_s']:20.1f} / {warm['first_iteration_s']:.1f}"
                f"{warm['rollout_share']:16.0%}  {bare:>12}",
                flush=True,
            )


if __name__ == "__main__":
    main()
