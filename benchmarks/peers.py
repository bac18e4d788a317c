"""Whole trainings in turns with other libraries': `python -m benchmarks.peers` (extra `peers`).

HalfCheetah for all. PPO and MOPG: 16 environments x 128 steps, minibatches of 64, 10 epochs, bodies
of 64 x 64. SAC: one gradient step on 256 old steps for each new step, bodies of 256 x 256.
Each training runs in a process of its own; the speed is that of the whole training loop, metrics
and checkpoints included, after its first report, whose time stands beside it.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hitmdp_jax.runs.metrics import read_metrics

TASK = "HalfCheetah-v5"
NUM_ENVS, LENGTH, MINIBATCH, EPOCHS, SIZES = 16, 128, 64, 10, (64, 64)
STEPS = NUM_ENVS * LENGTH  # of an iteration
ON_POLICY = (f"num_envs={NUM_ENVS}", f"rollout_length={LENGTH}", "physics=native")
WARM_UP = 1_000  # random steps before SAC learns
OFF_POLICY = ("algo=sac", f"algo.warmup_steps={WARM_UP}", "physics=native")

Figures = dict[str, float]  # steps_per_second of all seeds together, first_update_s


def ours(seconds: float, *settings: str) -> Figures:
    """Train by the command line until the time is up and three reports are there."""
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        command = [
            sys.executable, "-m", "hitmdp_jax", "train", "env=halfcheetah", "total_steps=1e9",
            *settings, f"run_dir={run_dir}",
        ]  # fmt: skip
        start = time.perf_counter()
        reports = []  # times, and steps of all seeds until then
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            while len(reports) < 3 or reports[-1][0] - reports[0][0] < seconds:
                time.sleep(0.05)
                steps = _steps(run_dir)
                if steps > (reports[-1][1] if reports else 0):
                    reports.append((time.perf_counter(), steps))
                if process.poll() is not None:
                    raise RuntimeError(f"{' '.join(command)} failed")
            process.terminate()
    (first, before), (last, after) = reports[0], reports[-1]
    return {"steps_per_second": (after - before) / (last - first), "first_update_s": first - start}


def _steps(run_dir: Path) -> int:
    """Return the environment steps of all seeds that a run has reported so far."""
    metrics = read_metrics(run_dir) if (run_dir / "metrics.csv").exists() else {}
    return int(metrics["env_steps"][:, -1].sum()) if metrics else 0


def sb3(seconds: float, library: Any = None) -> Figures:
    """Train Stable-Baselines3's PPO, or that of a library of its interface, on Gymnasium's task."""
    import stable_baselines3  # pyright: ignore
    from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore
    from stable_baselines3.common.env_util import make_vec_env  # pyright: ignore

    start = time.perf_counter()
    times = []

    class Clock(BaseCallback):
        def _on_step(self) -> bool:
            return len(times) < 2 or time.perf_counter() - times[0] < seconds

        def _on_rollout_start(self) -> None:
            if self.num_timesteps:  # each rollout but the first follows an update
                times.append(time.perf_counter())

    model = (library or stable_baselines3).PPO(
        "MlpPolicy", make_vec_env(TASK, NUM_ENVS), n_steps=LENGTH, batch_size=MINIBATCH,
        n_epochs=EPOCHS, policy_kwargs={"net_arch": list(SIZES)}, device="cpu",
    )  # fmt: skip
    model.learn(10**9, callback=Clock())
    steps = STEPS * (len(times) - 1)
    return {
        "steps_per_second": steps / (times[-1] - times[0]),
        "first_update_s": times[0] - start,
    }


def sbx(seconds: float) -> Figures:
    """Train SBX's PPO, Stable-Baselines3's sibling in JAX, on Gymnasium's task."""
    import sbx  # pyright: ignore

    return sb3(seconds, sbx)


def sbx_sac(seconds: float) -> Figures:
    """Train SBX's SAC with its default sizes, which are ours."""
    import sbx  # pyright: ignore
    from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore

    start = time.perf_counter()
    first = WARM_UP + 1_048  # our first report is made there
    times: dict[int, float] = {}

    class Clock(BaseCallback):
        def _on_step(self) -> bool:
            if self.num_timesteps >= first:
                times[self.num_timesteps] = time.perf_counter()
            return not times or times[self.num_timesteps] - times[first] < seconds

    model = sbx.SAC("MlpPolicy", TASK, learning_starts=WARM_UP)
    model.learn(10**9, callback=Clock())
    last = max(times)
    return {
        "steps_per_second": (last - first) / (times[last] - times[first]),
        "first_update_s": times[first] - start,
    }


ROWS: dict[str, Callable[[float], Figures]] = {
    "sb3 PPO": sb3,
    "sbx PPO": sbx,
    "hitmdp_jax PPO": lambda s: ours(s, "algo=ppo", *ON_POLICY),
    "hitmdp_jax MOPG": lambda s: ours(s, "algo=mopg", *ON_POLICY),
    "hitmdp_jax MOPG, mjx": lambda s: ours(s, "algo=mopg", *ON_POLICY[:2], "physics=mjx"),
    "hitmdp_jax PPO, 10 seeds": lambda s: ours(s, "algo=ppo", *ON_POLICY, "seeds=10"),
    "hitmdp_jax MOPG, 10 seeds": lambda s: ours(s, "algo=mopg", *ON_POLICY, "seeds=10"),
    "sbx SAC": sbx_sac,
    "hitmdp_jax SAC": lambda s: ours(s, *OFF_POLICY),
    "hitmdp_jax SAC, 4 seeds": lambda s: ours(s, *OFF_POLICY, "seeds=4"),
}


def in_own_process(name: str, seconds: float, cache: str) -> Figures | None:
    """Measure one row as a fresh process sees it; None where its library does not run here."""
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": cache}
    command = [sys.executable, "-m", "benchmarks.peers", "--row", name, "--seconds", str(seconds)]
    out = subprocess.run(command, capture_output=True, text=True, env=environment)
    if out.returncode:
        print(f"{name}: {(out.stderr.splitlines() or ['failed'])[-1]}", file=sys.stderr)
        return None
    return json.loads(out.stdout.splitlines()[-1])


def main() -> None:
    """Print the table, or one row of it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of training, each turn")
    parser.add_argument("--turns", type=int, default=3, help="turns, of which the median is told")
    parser.add_argument("--only", nargs="+", default=list(ROWS), help="these rows")
    parser.add_argument("--row", help="measure one row in this process")
    options = parser.parse_args()
    if options.row:
        print(json.dumps(ROWS[options.row](options.seconds)))
        return
    found: dict[str, list[Figures]] = {name: [] for name in options.only}
    with tempfile.TemporaryDirectory() as cache:
        for name in list(found) * options.turns:
            if name in found and (figures := in_own_process(name, options.seconds, cache)):
                found[name].append(figures)
            else:
                found.pop(name, None)
    base = _median(next(iter(found.values()), []), "steps_per_second")
    print("| training | env steps/s | x the first | first report (s) |\n| --- | --- | --- | --- |")
    for name, turns in found.items():
        speed = _median(turns, "steps_per_second")
        # The first turn compiles; the later ones find that in the cache.
        starts = " / ".join(
            f"{turns[i]['first_update_s']:.0f}" for i in sorted({0, len(turns) - 1})
        )
        print(f"| {name} | {speed:,.0f} | {speed / base:.1f} | {starts} |")


def _median(turns: list[Figures], name: str) -> float:
    return statistics.median(figures[name] for figures in turns) if turns else float("nan")


if __name__ == "__main__":
    main()
