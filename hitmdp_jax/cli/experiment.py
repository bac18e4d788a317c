"""Answer a question by an experiment: `hitmdp experiment NAME [name=value ...]`.

An experiment trains several arms on several tasks, with several seeds each. An arm is an algorithm
with its settings. The results of an arm on a task are published as soon as they are there, and a
table for each task says whether the differences are more than luck. Nothing is trained twice: with
`seeds=16` only the seeds that are missing are trained, and a stopped experiment continues. NAME is
one of the names below, or the path of a YAML file of your own (hitmdp_jax/experiments/catalogue/
has examples).

  tasks=, arms=  a part of the experiment: `table1 tasks=swimmer arms=mopg,ppo`; an arm may also be
                 path/to/file.py:Class, an algorithm of your own
  results=       the folder of the published results
  page=          the page about the experiment, in Markdown
  run_dir=       the folder of the trainings (default: runs/experiments/NAME)
  --trust        execute the Python files that the experiment or the results name, even if no
                 command line of yours has named them before

`results` draws the figures in `results/` and writes docs/results.md. `curves` draws every learning
curve and seed on one page, results.html. Both take `results=`, `page=` and --trust.

All other settings are those of train.py: `compare env=hopper arms=mopg,ppo seeds=4`,
`compare experiment=transfer pair=cheetah`, `embedding seed=200 seeds=8`.
"""

from hitmdp_jax.cli.guard import dispatched, work_of
from hitmdp_jax.experiments.experiment import names, read

TELLERS = ("results", "curves")  # what takes the place of an experiment's name


def main() -> None:
    """Run the command line."""
    dispatched(_usage, _run)


def _usage() -> str:
    lines = [f"  {name:<14} {read(name).title}" for name in names()]
    return "\n".join([str(__doc__), "Experiments:", *lines])


def _run(name: str, arguments: list[str]) -> int:
    if name not in TELLERS:
        read(name)  # a name that there is not needs no imports of what trains
    return work_of("cells").run(name, arguments)
