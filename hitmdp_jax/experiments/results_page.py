"""docs/results.md: what was measured, from the published results alone."""

import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hitmdp_jax.experiments import statistics
from hitmdp_jax.experiments.results import BOTH, DRAWING, EPISODES, Cell, Columns, read
from hitmdp_jax.experiments.statistics import (
    against,
    interquartile_mean,
    number,
    rounding,
)
from hitmdp_jax.experiments.tables import Rows, markdown
from hitmdp_jax.experiments.used_options import counts
from hitmdp_jax.training.sweep import PREFIX

INTRODUCTION = f"""# What was measured

Written by `python -m hitmdp_jax reproduce results` from the raw data in `results/`, which the
commands below made; nothing here is typed by hand. Returns are undiscounted.

- *last {EPISODES} episodes*: of the training policy, over which the paper averages its curves; mean
  and standard deviation over seeds;
- *IQM*: interquartile mean over seeds of the training policy's last 100k steps, with its 95%
  bootstrap interval (Agarwal et al. 2021), which fewer than five seeds do not have;
- *deterministic*: {EPISODES} episodes a seed of the final policy's likeliest options and actions;
  mean and standard deviation over seeds;
- *P(better)*: the probability that a seed of the algorithm beats one of the control; *P(mopg
  better)*: that a seed of MOPG beats one of the algorithm;
- *success*, in mazes: episodes of the last 100k steps in which the goal was reached; mean and
  standard deviation over seeds;
- *options, duration*: seeds in which two options or more have at least 5% of the last 100k steps
  each, and how many steps the option used most lasts (median of seeds);
- *choices*: do options matter? IQM of the training policy's episodes with its own choices, with
  uniform ones at every step, and with the best and the worst option of each seed kept throughout;
- *own minus uniform*: the IQM over seeds of the difference that a seed's own choices make, with its
  95% bootstrap interval. Where it holds zero, choosing was worth nothing.
"""


@dataclasses.dataclass(frozen=True)
class Suite:
    """A table: algorithms' arms on tasks, and what the paper says of them."""

    title: str
    about: str
    settings: list[str]  # of every run
    tasks: dict[str, list[str]]  # name -> what is its own
    arms: dict[str, list[str]]
    control: str | None  # the arm that the others are measured against
    paper: dict[str, dict[str, float]]  # arm -> task -> the paper's return
    elsewhere: str  # what others published
    policies: list[str]  # the arms whose best policy is published

    def settings_of(self, task: str, arm: str) -> list[str]:
        """Return the settings of one cell; those of every run yield to its own."""
        own = [*self.tasks[task], *self.arms[arm]]
        names = {text.split("=", 1)[0] for text in own}
        return [*own, *(text for text in self.settings if text.split("=", 1)[0] not in names)]

    def published(self, results: Path) -> dict[str, dict[str, Cell]]:
        """Return the cells that lie in a folder, by task and arm."""
        return {
            task: {arm: cell for arm in self.arms if (cell := read(results / task / arm))}
            for task in self.tasks
        }


def page(suites: Mapping[str, Suite], results: Path, link: str) -> str:
    """Return the page, in Markdown.

    Args:
      suites: name -> table.
      results: the folder of the published cells.
      link: that folder as the page names it.
    """
    sections = [section(name, suite, results, link) for name, suite in suites.items()]
    return "\n".join([INTRODUCTION, *sections])


def section(name: str, suite: Suite, results: Path, link: str) -> str:
    """Return what is told of one table: a table a task, what is missing, and the commands.

    Args:
      name: the table's.
      suite: the table.
      results: the folder of the published cells.
      link: that folder as the page names it.
    """
    cells = suite.published(results)
    parts = [f"## {suite.title}\n", suite.about, ""]
    parts += [suite.elsewhere, ""] if suite.elsewhere else []
    parts += [f"`python -m hitmdp_jax reproduce {name}` makes it, or goes on with it.", ""]
    if (results / f"{name}.png").is_file():
        parts += [f"![mean and standard deviation of the seeds' returns]({link}/{name}.png)\n"]
    if len(together := all_tasks(suite, cells)) > 1:
        parts += ["All tasks together:\n", markdown(together)]
    for task, published in cells.items():
        if published:
            parts += [f"### {task}\n", markdown(table(suite, task, published))]
            drawn = [arm for arm in published if (results / task / arm / DRAWING).is_file()]
            parts += [f"![options used]({link}/{task}/{arm}/{DRAWING})\n" for arm in drawn]
    missing = {
        task: [arm for arm in suite.arms if arm not in published]
        for task, published in cells.items()
    }
    if any(missing.values()):
        told = "; ".join(f"{task} ({', '.join(arms)})" for task, arms in missing.items() if arms)
        parts += [f"Not run: {told}.\n"]
    runs = {
        f"{task}/{arm}": cell
        for task, published in cells.items()
        for arm, cell in published.items()
    }
    if runs:
        tables = map(markdown, commands(runs))
        parts += ["<details><summary>Commands</summary>\n", *tables, "</details>\n"]
    return "\n".join(parts)


def commands(runs: Mapping[str, Cell]) -> tuple[Rows, Rows]:
    """Return what made each cell, and the versions and machines that the first numbers.

    Args:
      runs: name -> cell.
    """
    made_with = {name: cell.about["with"].split(BOTH) for name, cell in runs.items()}
    machines = list(dict.fromkeys(itertools.chain.from_iterable(made_with.values())))
    made = [["run", "command", "day", "hours", "with"]]
    for name, cell in runs.items():
        numbers = ", ".join(str(1 + machines.index(x)) for x in made_with[name])
        command, day = cell.about["command"], str(cell.about["day"])
        made.append([name, f"`{command}`", day, f"{cell.about['hours']:.2f}", numbers])
    numbered = [[str(i), machine] for i, machine in enumerate(machines, 1)]
    return made, [["with", "versions and device"], *numbered]


def all_tasks(suite: Suite, cells: Mapping[str, Mapping[str, Cell]]) -> Rows:
    """Return how often each arm beats the control, and the first arm beats it, as rows of text.

    Every task counts the same.

    Args:
      suite: the table; its first arm is the algorithm that it asks about.
      cells: those published, by task and arm. What counts are tasks with the arm, the control and
        the first arm; an arm with less than two of them is left out.
    """
    control, first = suite.control, next(iter(suite.arms))
    how = "mean over tasks [95% interval]"
    better = f"P(better than {control}), {how}", f"P({first} better), {how}"
    rows = [["", "tasks", "seeds", *better]]
    for arm in suite.arms:
        if control is None or arm == control:
            continue
        tasks = [here for here in cells.values() if {arm, control, first} <= here.keys()]
        if len(tasks) < 2:
            continue
        ours = "" if arm == first else _improvement(tasks, first, arm)
        counts = sorted({len(here[arm].seeds["last_100k_steps"]) for here in tasks})
        seeds = " or ".join(map(str, counts))
        rows.append([arm, str(len(tasks)), seeds, _improvement(tasks, arm, control), ours])
    return rows


def _improvement(tasks: Sequence[Mapping[str, Cell]], arm: str, other: str) -> str:
    pairs = [here[name].seeds["last_100k_steps"] for here in tasks for name in (arm, other)]
    return statistics.with_interval(statistics.mean_improvement, *pairs, spec=".2f", arms=2)


def table(suite: Suite, task: str, cells: Mapping[str, Cell]) -> Rows:
    """Return what a suite's arms did on a task as rows of text, the header first."""
    control = cells.get(suite.control or "")
    first = next(iter(cells.values()))
    if first.config.sweep:
        return _by_setting(first)
    transfer = first.config.switch_at is not None
    header = ["", "seeds", f"last {EPISODES} episodes", "IQM [95% interval]"]
    header += ["first task, IQM", "mean after the switch, IQM"] if transfer else []
    header += [f"minus {suite.control} [95% interval]", "P(better)"] if control else []
    succeeds = "success" in first.seeds
    header += ["success"] if succeeds else []
    header += ["deterministic", "options, duration", "choices", "own minus uniform", "paper"]
    rows = [header]
    spec = rounding(*(cell.seeds["last_100k_steps"] for cell in cells.values()))
    with_interval = functools.partial(statistics.with_interval, spec=spec)
    for arm, cell in cells.items():
        seeds = cell.seeds
        row = [arm, str(len(seeds["seed"])), _spread(seeds["last_20_episodes"], spec)]
        row += [with_interval(interquartile_mean, seeds["last_100k_steps"])]
        if transfer:
            names = ("first_task", "whole_second_task")
            row += [with_interval(interquartile_mean, seeds[name]) for name in names]
        if control:
            row += against(seeds["last_100k_steps"], control.seeds["last_100k_steps"], spec)
        row += [_spread(seeds["success"], ".2f")] if succeeds else []
        printed = suite.paper.get(arm, {}).get(task, np.nan)
        row += [_spread(seeds["evaluation"], spec), _options(seeds), *_choices(seeds)]
        rows.append([*row, number(printed)])
    return rows


def _options(seeds: Columns) -> str:
    if "options_used" not in seeds:
        return "-"
    used = seeds["options_used"]
    duration = float(np.median(seeds["main_option_duration"]))
    return f"{(used >= 2).sum()}/{len(used)}, {number(duration)}"


def _choices(seeds: Columns) -> list[str]:
    if "own_choices" not in seeds:
        return ["-", "-"]
    names = ("own_choices", "uniform_choices", "best_option", "worst_option")
    every = [seeds[name] for name in names]
    spec = rounding(*every)
    gain = statistics.with_interval(interquartile_mean, every[0] - every[1], spec=".2f")
    return [" / ".join(number(float(interquartile_mean(x)), spec) for x in every), gain]


def _by_setting(cell: Cell) -> Rows:
    """Return how many options each setting of a sweep uses, as Figure 11 counts them."""
    seeds, name = cell.seeds, cell.swept
    values, used = counts(seeds, name, cell.num_options)
    numbers = [f"{k} option{'s' if k > 1 else ''}" for k in range(1, cell.num_options + 1)]
    rows = [[name.removeprefix(PREFIX), "seeds", *numbers, "IQM [95% interval]", "deterministic"]]
    for value, row in zip(values, used, strict=True):
        own = {column: x[seeds[name] == value] for column, x in seeds.items()}
        returns = statistics.with_interval(interquartile_mean, own["last_100k_steps"])
        score = _spread(own["evaluation"])
        rows.append([f"{value:g}", str(len(own["seed"])), *map(str, row), returns, score])
    return rows


def _spread(x: np.ndarray, spec: str = ".1f") -> str:
    return f"{number(float(np.mean(x)), spec)} ± {number(float(np.std(x)), spec)}"
