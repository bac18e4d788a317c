"""The page about experiments in Markdown: what was measured, from the published results alone."""

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from hitmdp_jax.experiments.experiment import Experiment
from hitmdp_jax.experiments.published import BOTH, Cell, Cells
from hitmdp_jax.experiments.tables import Rows, markdown
from hitmdp_jax.interpret.comparison import table
from hitmdp_jax.interpret.statistics import (
    bootstrap_interval,
    mean_improvement,
    number_text,
    with_interval,
)
from hitmdp_jax.interpret.summary import EPISODES, Summary
from hitmdp_jax.training.sweep import PREFIX

INTRODUCTION = f"""# What was measured

This page has the numbers of all experiments that are published. The command
`hitmdp experiment results` writes it from the raw data in `results/`, and no number is typed by
hand. Each section ends with the commands that made its data. Returns are not discounted.

An *experiment* trains several *arms* on several *tasks*. An arm is an algorithm with its settings;
each row of a table is an arm. One arm is the *control*, with which the others are compared. A
*seed* is one training from its own random numbers. An *option* is a skill that lasts several
steps, and the algorithm chooses among its options. [The outcome](outcome.md) says in words what
the numbers mean, and spells out the names of the algorithms. `mopg-printed` is MOPG with every
choice as the paper prints it, `mopg-one` is MOPG with one option, and so on.

These are the columns:

- *seeds*: how many seeds were trained.
- *IQM of the last 100,000 steps*: the return during the last 100,000 steps of training. It is the
  interquartile mean over seeds, which is the mean of the middle half, with its 95% bootstrap
  interval (Agarwal et al. 2021). With fewer than five seeds there is no interval.
- *minus ppo* (or another control): the arm's return minus the control's.
- *P(better)*: the probability that a seed of the arm returns more than a seed of the control.
  *P(mopg better)* is the probability that a seed of MOPG returns more than a seed of the arm.
- *paper*: the return that the paper reports.
- *last {EPISODES} episodes*: the return of the last {EPISODES} episodes of training. The paper
  averages its curves over as many. It is the mean over seeds, with the standard deviation.
- *first task* and *mean after the switch*, in transfers: the return at the end of the first task,
  and the mean return of the whole second task; both are IQMs over seeds.
- *failed*: seeds whose return over the last 100,000 steps is less than half of the median seed's.
  If returns are negative, it is less than twice the median seed's.
- *success*, in mazes: the share of episodes in the last 100,000 steps in which the robot reached
  the goal; mean and standard deviation over seeds.
- *deterministic*: the return of the final policy when it takes its most likely option and action
  at every step, over {EPISODES} episodes per seed; mean and standard deviation over seeds.
- *steps/s*: environment steps per second, of all seeds together.
- *parameters*: the number of parameters of one seed.
- *options, duration*: first, the number of seeds that use at least two options for 5% or more of
  the last 100,000 steps each; then, how many steps the most used option lasts (median of seeds).
- *choices*: do options matter? The return of the final training policy with four ways of choosing
  options: its own choices / a random option at every step / always the best single option of the
  seed / always the worst one. Each number is an IQM over seeds.
- *own minus uniform*: what the policy's own choices return above random (uniform) ones, as an IQM
  over seeds with its 95% bootstrap interval. If the interval contains zero, we see no benefit of
  choosing.
"""
PAIRS = (
    "How often does a seed of the row's arm return more than a seed of the column's? Mean over the "
    "tasks that have both arms:"
)
TABLES = {  # of a task, each narrow enough for a page: a caption, and its columns' titles
    "Returns:": re.compile(r"seeds|IQM of.*|minus .*|P\(.*better\)|paper|failed"),
    "More about the policies:": re.compile(r".*, IQM|last .*|success|det.*|steps/s|param.*"),
    "Options:": re.compile(r"\d+ options?|options, duration|choices|own minus uniform"),
}


def page(experiments: Mapping[str, Experiment], cells: Cells, pictures: Mapping[str, str]) -> str:
    """Return the page, in Markdown.

    Args:
      experiments: name -> experiment.
      cells: what is published.
      pictures: name -> where the page finds a figure of the experiment.
    """
    sections = [section(name, x, cells, pictures.get(name)) for name, x in experiments.items()]
    return "\n".join([INTRODUCTION, *sections])


def section(name: str, experiment: Experiment, cells: Cells, picture: str | None = None) -> str:
    """Return the section about one experiment: tables of each task, what is missing, commands.

    Args:
      name: the experiment's.
      experiment: what it is.
      cells: what is published; what other experiments ask for is left out.
      picture: where the page finds a figure of it.
    """
    cells = shown(experiment, cells)
    parts = [f"## {experiment.title}\n", experiment.about, ""]
    parts += [experiment.elsewhere, ""] if experiment.elsewhere else []
    parts += [f"The command `hitmdp experiment {name}` trains these runs, or adds to them.", ""]
    parts += [f"![the results of this section as a picture]({picture})\n"] if picture else []
    if len(together := all_tasks(experiment, cells)) > 1:
        parts += ["All tasks together:\n", markdown(together)]
    if len(pairs := all_pairs(experiment, cells)) > 2:
        parts += [f"{PAIRS}\n", markdown(pairs)]
    for task, published in cells.items():
        if published:
            parts += [f"### {task}\n", *narrow_tables(task_table(experiment, task, published))]
    missing = {
        task: [arm for arm in experiment.arms if arm not in published]
        for task, published in cells.items()
    }
    if any(missing.values()):
        told = "; ".join(f"{task} ({', '.join(arms)})" for task, arms in missing.items() if arms)
        parts += [f"Not run: {told}.\n"]
    runs = {
        f"{task}/{arm}": cell.summary
        for task, published in cells.items()
        for arm, cell in published.items()
    }
    if runs:
        tables = map(markdown, commands(runs))
        parts += ["<details><summary>Commands</summary>\n", *tables, "</details>\n"]
    return "\n".join(parts)


def shown(experiment: Experiment, cells: Cells) -> dict[str, dict[str, Cell]]:
    """Return the cells of an experiment that are published, in its order."""
    return {
        task: {arm: cells[task][arm] for arm in experiment.arms if arm in cells.get(task, {})}
        for task in experiment.tasks
    }


def task_table(experiment: Experiment, task: str, cells: Mapping[str, Cell]) -> Rows:
    """Return the results of an experiment's arms on a task as rows of text, the header first."""
    runs = {arm: cell.summary for arm, cell in cells.items()}
    if len(runs) == 1 and (swept := next(iter(runs.values()))).swept:
        settings = swept.by_setting()
        return table(settings, index=used_options(swept, settings))
    printed = {arm: of[task] for arm, of in experiment.paper.items() if task in of}
    return table(runs, experiment.control, printed)


def narrow_tables(rows: Rows) -> list[str]:
    """Split a wide table into several with the same first column, each as captioned Markdown."""
    header, parts = rows[0], []
    for caption, titles in TABLES.items():
        kept = [0, *(i for i, title in enumerate(header) if i and titles.fullmatch(title))]
        if len(kept) > 1:
            narrow = [[row[i] for i in kept] for row in rows]
            known = [row for row in narrow if set(row[1:]) - {"-"}]  # PPO has no options
            parts += [f"{caption}\n", markdown(known)]
    return parts


def used_options(swept: Summary, settings: Mapping[str, Summary]) -> list[list[str]]:
    """Return each setting's value, and how many seeds use k options, as Figure 11 counts them."""
    each = range(1, swept.num_options + 1)
    numbers = [f"{k} option{'s' if k > 1 else ''}" for k in each]
    index = [[swept.swept.removeprefix(PREFIX), *numbers]]
    for run in settings.values():
        used = run.columns["options_used"]
        counts = [str(int((used == k).sum())) for k in each]
        index.append([f"{run.columns[swept.swept][0]:g}", *counts])
    return index


def commands(runs: Mapping[str, Summary]) -> tuple[Rows, Rows]:
    """Return the command of each cell, and the versions and machines, numbered in the first.

    Args:
      runs: name -> what is known of a run.
    """
    made_with = {name: run.about["with"].split(BOTH) for name, run in runs.items()}
    machines = list(dict.fromkeys(itertools.chain.from_iterable(made_with.values())))
    made = [["run", "command", "day", "hours", "with"]]
    for name, run in runs.items():
        numbers = ", ".join(str(1 + machines.index(x)) for x in made_with[name])
        command, day = run.about["command"], str(run.about["day"])
        made.append([name, f"`{command}`", day, f"{run.about['hours']:.2f}", numbers])
    numbered = [[str(i), machine] for i, machine in enumerate(machines, 1)]
    return made, [["with", "versions and device"], *numbered]


def all_tasks(experiment: Experiment, cells: Cells) -> Rows:
    """Return how often each arm beats the control, and the first arm beats it, as rows of text.

    Every task counts the same.

    Args:
      experiment: what is asked; its first arm is the algorithm that it asks about.
      cells: those published, by task and arm. What counts are tasks with the arm, the control and
        the first arm; an arm with less than two of them is left out.
    """
    control, first = experiment.control, next(iter(experiment.arms))
    how = "mean over tasks [95% interval]"
    better = f"P(better than {control}), {how}", f"P({first} better), {how}"
    rows = [["", "tasks", "seeds", *better]]
    for arm in experiment.arms:
        if control is None or arm == control:
            continue
        tasks = tasks_of(experiment, cells, arm, control, first)
        if len(tasks) < 2:
            continue
        ours = "" if arm == first else _told(tasks, first, arm)
        counts = sorted({len(here[arm].summary.returns) for here in tasks})
        seeds = " or ".join(map(str, counts))
        rows.append([arm, str(len(tasks)), seeds, _told(tasks, arm, control), ours])
    return rows


def all_pairs(experiment: Experiment, cells: Cells) -> Rows:
    """Return how often a seed of each arm beats one of each other, as rows of text.

    Args:
      experiment: what is asked.
      cells: those published, by task and arm. What counts are the tasks with both arms, two at
        least; an arm that has none in common with any is left out.
    """
    found = {
        (arm, other): number_text(float(mean_improvement(*_pairs(tasks, arm, other))), ".2f")
        for arm, other in itertools.permutations(experiment.arms, 2)
        if len(tasks := tasks_of(experiment, cells, arm, other)) > 1
    }
    arms = [arm for arm in experiment.arms if any(arm in pair for pair in found)]
    rows = [[arm, *(found.get((arm, other), "") for other in arms)] for arm in arms]
    return [["", *arms], *rows]


def tasks_of(experiment: Experiment, cells: Cells, *arms: str) -> list[Mapping[str, Cell]]:
    """Return the cells of an experiment's tasks, by arm, on which all of these arms were run."""
    here = (cells.get(task, {}) for task in experiment.tasks)
    return [known for known in here if {*arms} <= known.keys()]


def improvement(
    tasks: Sequence[Mapping[str, Cell]], arm: str, other: str
) -> tuple[float, float, float]:
    """Return the probability that a seed of an arm beats one of another, mean over tasks.

    Its 95% interval's ends follow; NaN of few seeds.
    """
    pairs = _pairs(tasks, arm, other)
    return float(mean_improvement(*pairs)), *bootstrap_interval(mean_improvement, *pairs, arms=2)


def _told(tasks: Sequence[Mapping[str, Cell]], arm: str, other: str) -> str:
    return with_interval(mean_improvement, *_pairs(tasks, arm, other), spec=".2f", arms=2)


def _pairs(tasks: Sequence[Mapping[str, Cell]], arm: str, other: str) -> list[np.ndarray]:
    return [here[name].summary.returns for here in tasks for name in (arm, other)]
