"""Reproduce the paper: `python -m hitmdp_jax.reproduce TARGET [name=value ...]`.

Targets:
  compare  trains every algorithm of `algos=` (`all`, or a list as `mopg,ppo`) on one task, or on
           a pair of them, one after the other, and writes one table and one figure in the style of
           Figures 3 and 4. The other settings are those of train.py: `compare env=halfcheetah
           algos=all seeds=4`, `compare experiment=transfer pair=cheetah algos=mopg,ppo`.
"""

import subprocess
import sys
import time
from pathlib import Path

import jax
from rich.console import Console
from rich.table import Table

import hitmdp_jax
from hitmdp_jax.agents import AGENTS
from hitmdp_jax.analysis import theorems
from hitmdp_jax.analysis.comparison import (
    Result,
    compare,
    comparison_figure,
    save_table,
    table,
)
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError, exit_with, out_of_domain, unknown_name
from hitmdp_jax.training.config import RunConfig

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
        TARGETS[arguments[0]](parse(arguments[1:]))
    except UsageError as error:
        exit_with(error)


def parse(overrides: list[str]) -> dict[str, str]:
    """Return the command line's settings.

    Raises:
      UsageError: an argument is not of the form name=value.
    """
    for text in overrides:
        if "=" not in text:
            raise UsageError(f"'{text}' is not of the form name=value, e.g. seed=1.")
    return dict(text.split("=", 1) for text in overrides)


def run_comparison(settings: dict[str, str]) -> None:
    """Train every algorithm in a process of its own and compare the runs.

    Raises:
      UsageError: an algorithm is unknown, or a run failed.
    """
    named = settings.pop("algos", "all")
    algos = sorted(AGENTS) if named == "all" else named.split(",")
    for algo in algos:
        if algo not in AGENTS:
            raise unknown_name("algo", algo, AGENTS)
    name = settings.get("pair", settings.get("env", "halfcheetah"))
    default = f"runs/compare/{name}/{time.strftime('%Y-%m-%d_%H-%M-%S')}"
    folder = Path(settings.pop("run_dir", default))
    run_dirs = {algo: folder / algo for algo in algos}
    for algo, run_dir in run_dirs.items():
        if (run_dir / "checkpoints").exists():
            print(f"{algo}: taken from {run_dir}")
            continue
        train(algo, run_dir, settings)
    config = RunConfig.load(run_dirs[algos[0]])
    parameters = {algo: count_parameters(d) for algo, d in run_dirs.items()}
    results = compare(run_dirs, parameters, since=config.switch_at or 0)
    save_table(results, folder)
    figure = comparison_figure(run_dirs, config.task_title, config.switch_at)
    figure.savefig(folder / "comparison.png", dpi=150)
    show(results)
    print(f"Saved in {folder}.")


def draw_theorems(settings: dict[str, str]) -> None:
    """Compute and draw Theorem 3.3 and Proposition 3.5.

    Raises:
      UsageError: a setting is unknown, the seed is no seed, or the folder cannot be made.
    """
    defaults = {"run_dir": f"runs/theory/{time.strftime('%Y-%m-%d_%H-%M-%S')}", "seed": "0"}
    for name in settings:
        if name not in defaults:
            raise unknown_name("setting", name, defaults)
    settings = defaults | settings
    seed, folder = settings["seed"], Path(settings["run_dir"])
    if not seed.isdecimal() or int(seed) >= 2**32:
        raise out_of_domain("seed", seed, "a whole number from 0 to 4294967295")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"run_dir = {folder} cannot be made: {error.strerror}.") from None
    with jax.enable_x64(True):
        models = theorems.sample_models(jax.random.key(int(seed)))
        figures = {
            "contraction": theorems.contraction_figure(theorems.contraction(models)),
            "variance": theorems.variance_figure(
                theorems.variances(models), theorems.variances(models, (0.1,), at_start=True)
            ),
        }
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=150)
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


TARGETS = {"compare": run_comparison, "theory": draw_theorems}


if __name__ == "__main__":
    main()
