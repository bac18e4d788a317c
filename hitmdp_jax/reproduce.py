"""Reproduce the paper's comparisons: `python -m hitmdp_jax.reproduce TARGET [name=value ...]`.

Targets:
  compare  trains every algorithm of `algos=` (`all`, or a list as `mopg,ppo`) on one task, one
           after the other, and writes one table and one figure in the style of Figure 3.
           The other settings are those of train.py: `compare env=halfcheetah algos=all seeds=4`.
"""

import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import hitmdp_jax
from hitmdp_jax.agents import AGENTS
from hitmdp_jax.analysis.comparison import (
    Result,
    compare,
    comparison_figure,
    interquartile_means,
    save_table,
    table,
)
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError, exit_with, unknown_name
from hitmdp_jax.training.config import RunConfig

TARGETS = ("compare",)
CHECKOUT = Path(hitmdp_jax.__file__).parents[1]


def main() -> None:
    """Run the command line."""
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return
    try:
        if arguments[0] not in TARGETS:
            raise unknown_name("target", arguments[0], TARGETS)
        run_comparison(arguments[1:])
    except UsageError as error:
        exit_with(error)


def run_comparison(overrides: list[str]) -> None:
    """Train every algorithm in a process of its own and compare the runs.

    Raises:
      UsageError: an algorithm is unknown, an extra is missing, or a run failed.
    """
    settings = dict(text.split("=", 1) for text in overrides if "=" in text)
    named = settings.pop("algos", "all")
    algos = sorted(AGENTS) if named == "all" else named.split(",")
    for algo in algos:
        if algo not in AGENTS:
            raise unknown_name("algo", algo, AGENTS)
    interquartile_means({"check": np.arange(4.0)})  # before hours of training, not after
    task = settings.get("env", "halfcheetah")
    default = f"runs/compare/{task}/{time.strftime('%Y-%m-%d_%H-%M-%S')}"
    folder = Path(settings.pop("run_dir", default))
    run_dirs = {algo: folder / algo for algo in algos}
    for algo, run_dir in run_dirs.items():
        if (run_dir / "checkpoints").exists():
            print(f"{algo}: taken from {run_dir}")
            continue
        train(algo, run_dir, settings)
    results = compare(run_dirs, {algo: count_parameters(d) for algo, d in run_dirs.items()})
    save_table(results, folder)
    comparison_figure(run_dirs, task).savefig(folder / "comparison.png", dpi=150)
    show(results)
    print(f"Saved in {folder}.")


def train(algo: str, run_dir: Path, settings: dict[str, str]) -> None:
    """Run train.py.

    Raises:
      UsageError: the package is not in a checkout, or the run failed; it has said why.
    """
    script = CHECKOUT / "train.py"
    if not script.is_file():
        raise UsageError(f"Comparisons run train.py, which is not in '{CHECKOUT}'.")
    overrides = [f"{name}={value}" for name, value in settings.items()]
    command = [sys.executable, str(script), f"algo={algo}", f"run_dir={run_dir}", *overrides]
    if subprocess.run(command).returncode:
        raise UsageError(f"The run of {algo} failed; the comparison stopped there.")


def count_parameters(run_dir: Path) -> int:
    """Return the number of parameters of one seed of a run."""
    config = RunConfig.load(run_dir)
    env = make_env(**config.env, physics=config.physics)
    assert isinstance(env.observation_size, int)
    sizes = env.observation_size, env.action_size
    state = jax.eval_shape(lambda key: config.make_agent().init(key, *sizes), jax.random.key(0))
    return sum(x.size for x in jax.tree.leaves(state.params))


def show(results: list[Result]) -> None:
    """Print the comparison."""
    header, *rows = table(results)
    printed = Table(*header)
    for row in rows:
        printed.add_row(*row)
    Console().print(printed)


if __name__ == "__main__":
    main()
