"""How a command line names one policy of a run."""

import argparse
from pathlib import Path
from typing import NamedTuple

from hitmdp_jax.cli.settings import Parser
from hitmdp_jax.runs.config import RunConfig, Task
from hitmdp_jax.runs.policy import Policy, load_all, places
from hitmdp_jax.training.sweep import Training


class Chosen(NamedTuple):
    """One policy of a run."""

    config: RunConfig
    training: Training
    iteration: int  # of the checkpoint
    policy: Policy
    name: str  # for files: the environment steps, and what the command line named

    @property
    def env_steps(self) -> int:
        """Environment steps that the policy learned from."""
        return self.config.schedule.steps_after(self.iteration)

    @property
    def task(self) -> Task:
        """The task that the policy learned last; Raises as `RunConfig.task_at`."""
        return self.config.task_at(self.iteration)


def add_choice(parser: Parser) -> None:
    """Let a command line name a run, and a training and a checkpoint of it."""
    parser.add_argument("run_dir", type=Path, metavar="RUN_DIR", help="a run's folder")
    parser.add_argument("--seed", type=int, default=None, help="one of the run's seeds; the first")
    parser.add_argument("--setting", type=int, default=None, help="one of a sweep's settings; 0")
    add_checkpoint(parser)


def add_checkpoint(parser: Parser) -> None:
    """Let a command line name a checkpoint, which `load_named` reads."""
    parser.add_argument("--checkpoint", default="newest", help="newest, best, or an iteration")
    parser.add_argument("--task", type=int, help="a transfer's: 0 or 1; the newest checkpoint's")


def load_named(options: argparse.Namespace) -> tuple[int, Policy]:
    """Read the checkpoint of a run that a command line names; Returns and Raises as `load_all`."""
    text = options.checkpoint
    which = int(text) if text.isascii() and text.isdecimal() else text
    return load_all(options.run_dir, which, options.task)


def load_chosen(options: argparse.Namespace) -> Chosen:
    """Read the policy that a command line names.

    Raises:
      UsageError: the folder holds no run, or no such seed, setting or checkpoint.
    """
    config = RunConfig.load(options.run_dir, options.trust)
    seed = config.seed if options.seed is None else options.seed
    (place,) = places(config.trainings, seed, options.setting or 0)
    iteration, everyone = load_named(options)
    named = {"seed": options.seed, "setting": options.setting}
    parts = [f"{name}{number}" for name, number in named.items() if number is not None]
    name = "_".join([str(config.schedule.steps_after(iteration)), *parts])
    return Chosen(config, config.trainings[place], iteration, everyone.of(place), name)
