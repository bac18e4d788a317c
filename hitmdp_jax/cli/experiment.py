"""Answer a question by an experiment: `hitmdp experiment NAME [name=value ...]`.

An experiment trains arms on tasks with several seeds each, one cell after another, publishes each
as soon as it is done and prints a table a task, which says whether differences are more than luck.
What is published is not trained again, seeds beyond those that are follow them (`seeds=16`), what
was stopped goes on. NAME is one of those below or the path of a YAML file of your own
(hitmdp_jax/experiments/catalogue/ has examples).

  tasks=, arms=  name a part of it: `table1 tasks=swimmer arms=mopg,ppo`; an arm may also be
                 path/to/file.py:Class, an algorithm of your own
  results=       the folder of what is published
  page=          the page about it, in Markdown
  run_dir=       the folder of the trainings, runs/experiments/NAME
  --trust        run the files of tasks and algorithms that the experiment or what is published
                 names and that no command line of yours has named before

`results` draws what is published in `results/` and writes docs/results.md; `curves` draws all of
its curves, seeds and profiles on one page, results.html. Both take `results=`, `page=` and --trust.

Other settings are those of train.py, for every run: `compare env=hopper arms=mopg,ppo seeds=4`,
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
