"""Reproduce the paper: `python -m hitmdp_jax reproduce TARGET [name=value ...]`.

Targets:
  compare  trains every algorithm of `algos=` (`all`, or a list as `mopg,ppo`) on one task, or on
           a pair of them, one after the other, and writes one table and one figure in the style of
           Figures 3 and 4. The other settings are those of train.py: `compare env=halfcheetah
           algos=all seeds=4`, `compare experiment=transfer pair=cheetah algos=mopg,ppo`. With
           `run_dir=` of an earlier comparison it goes on where that stopped.

  table1, table2, table3, figure11, options
           trains what the paper's table or figure shows, or tasks in which options should pay, one
           run after the other, publishes each in `results/` as soon as it is done and writes
           docs/results.md; what is published is not trained again, seeds beyond those that are
           follow them (`seeds=16`), what was stopped goes on.
           `tasks=` and `arms=` name a part of it (`table1 tasks=swimmer arms=mopg,ppo`); other
           settings are those of train.py (`seeds=4`).
  figure3, figure4
           the same of table1 and table2, and of table3, whose learning curves these figures show:
           results/table1.png and so on
  results  writes docs/results.md from what is published, and draws it (`results=`, `page=`: other
           places)
  curves   draws all published curves, seeds and profiles on one page, results.html
           `--trust` runs the files of tasks and algorithms that published settings name.

`hitmdp figure` draws the figures of a trained run.
"""

import time
from pathlib import Path

import jax

from hitmdp_jax import plugins
from hitmdp_jax.agents import AGENTS, find_agent
from hitmdp_jax.cli import suites
from hitmdp_jax.cli.arms import named, train_arms, without_folder
from hitmdp_jax.cli.guard import dispatched
from hitmdp_jax.cli.settings import Settings, folder_setting, writable
from hitmdp_jax.errors import UsageError, unknown_name, warn
from hitmdp_jax.experiments import tables
from hitmdp_jax.experiments.comparison import compare, comparison_figure, length_warning, table
from hitmdp_jax.figures.curves import save
from hitmdp_jax.plugins import label
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.policy import load


def main() -> None:
    """Run the command line."""
    dispatched(lambda: str(__doc__), _run)


def _run(target: str, arguments: list[str]) -> int:
    if target not in TARGETS:
        raise unknown_name("target", target, TARGETS)
    return TARGETS[target](arguments)


def run_comparison(arguments: list[str]) -> int:
    """Train every algorithm in a process of its own and compare the runs; return the exit code.

    Raises:
      UsageError: a setting is wrong, a folder holds another run, or a run failed.
    """
    algos, rest = _algorithms(arguments)
    name = named(rest).get("pair", named(rest).get("env", "halfcheetah"))
    values = Settings(rest).values()
    folder = folder_setting(values) or Path(
        f"runs/compare/{name.replace('/', '-')}/{time.strftime('%Y-%m-%d_%H-%M-%S')}"
    )
    writable("run_dir", folder, "comparison.png")
    arms = {name: [f"algo={algo}", *without_folder(rest)] for name, algo in algos.items()}
    if code := train_arms(arms, folder):
        return code
    run_dirs = {name: folder / name for name in algos}
    config = RunConfig.load(next(iter(run_dirs.values())))
    parameters = {algo: count_parameters(run_dir) for algo, run_dir in run_dirs.items()}
    results = compare(run_dirs, parameters, config.switch_at)
    if warning := length_warning({result.algo: result.env_steps for result in results}):
        warn(warning)
    rows = table(results)
    tables.save(rows, folder, "comparison")
    figure = comparison_figure(run_dirs, config.task_title, config.switch_at)
    save(figure, folder / "comparison.png")
    tables.show(rows)
    print(f"Saved in {folder}.")
    return 0


def _algorithms(arguments: list[str]) -> tuple[dict[str, str], list[str]]:
    """Return the algorithms of `algos=` by what their folders are called, and other arguments."""
    rest = [text for text in arguments if not text.startswith("algos=")]
    instead_of = {
        "algo": "algos= names", "resume": "run_dir= of it goes on with", "sweep": "algos= names"
    }  # fmt: skip
    for name, instead in instead_of.items():
        if name in named(rest):
            raise UsageError(f"compare takes no {name}=: {instead} what is compared.")
    listed = named(arguments).get("algos", "all")
    algos: dict[str, str] = {}
    for algo in sorted(AGENTS) if listed == "all" else listed.split(","):
        plugins.trust(algo, remember=True)
        find_agent(algo)
        name = label(algo)
        if name in algos:
            raise UsageError(f"algos = {listed} names {name} more than once.")
        algos[name] = algo
    return algos, rest


def count_parameters(run_dir: Path) -> int:
    """Return the number of parameters of one seed of a run."""
    config = RunConfig.load(run_dir)
    return sum(x.size for x in jax.tree.leaves(load(run_dir, config.seed).params))


TARGETS = {"compare": run_comparison, **suites.TARGETS}
