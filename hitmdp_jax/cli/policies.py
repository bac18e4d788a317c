"""How a command line names one policy of a run, and where what is made of it goes."""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import jax

from hitmdp_jax import plugins
from hitmdp_jax.cli.run_settings import task_setting, writable
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs import engine_for
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.config import RunConfig, Task, trust_named
from hitmdp_jax.runs.folder import is_policy, made, refuse_link
from hitmdp_jax.runs.policy import Policy, load_all, places
from hitmdp_jax.training.sweep import Training

SEED_OFFSET = 2**20  # keeps the keys of evaluations apart from those of trainings


class Chosen(NamedTuple):
    """One policy of a run."""

    config: RunConfig
    training: Training
    iteration: int  # of the checkpoint
    policy: Policy
    name: str  # for files: the environment steps, and what the command line named
    shown: RunConfig  # as `on_task` returns it: `config` itself, or on another task

    @property
    def env_steps(self) -> int:
        """Environment steps that the policy learned from."""
        return self.config.schedule.steps_after(self.iteration)

    @property
    def task(self) -> Task:
        """The task that the policy is looked at in; Raises as `RunConfig.task_at`.

        It is the one that the policy learned last, with the numbers of its setting, or another one.
        """
        if self.shown is not self.config:
            return self.shown.task_at(1)
        return self.config.task_at(self.iteration, self.training)

    @property
    def title(self) -> str:
        """What the policy learned, for how long, and where it is looked at if that is elsewhere."""
        title = f"{self.config.title}, {self.training.name}, {self.env_steps:,} env steps"
        other = f", in {self.shown.task_title}"
        return title + other * (self.shown is not self.config)


def load_config(arguments: argparse.Namespace) -> RunConfig:
    """Read the settings of the run that a command line names.

    Raises:
      UsageError: they cannot be read.
    """
    return RunConfig.load(arguments.run_dirs[0], arguments.trust)


def on_task(config: RunConfig, name: str | None) -> RunConfig:
    """Return a run's settings with another task in place of its own, whose actions last as long.

    Args:
      config: the run's.
      name: the task, as `env=` names it; None keeps the run's own, and returns `config` itself.

    Raises:
      UsageError: there is no such task; or none is named, and the run was saved without one.
    """
    if name is None:
        if not config.tasks:
            raise UsageError(
                "The run was saved from Python and names no task: name one, as --env halfcheetah."
            )
        return config
    values = Settings([f"env={name}"]).values()
    trust_named(values, remember=True)  # this user's command line names it
    task = task_setting(values) | {"action_repeat": config.action_repeat}
    engine = engine_for(task["name"], config.physics)
    return dataclasses.replace(config, env=task, second_env=None, physics=engine)


def load_named(arguments: argparse.Namespace) -> tuple[int, Policy]:
    """Read the checkpoint of a run that a command line names; Returns and Raises as `load_all`."""
    text = "newest" if arguments.checkpoint is None else arguments.checkpoint
    which = int(text) if text.isascii() and text.isdecimal() else text
    return load_all(arguments.run_dirs[0], which, arguments.task)


def file_name(*parts: str | None) -> str:
    """Return what a file is called, without its suffix, after a task of that name among others."""
    return "_".join(plugins.label(part).replace("/", "-") for part in parts if part is not None)


def load_chosen(
    arguments: argparse.Namespace, config: RunConfig, shown: RunConfig | None = None
) -> Chosen:
    """Read the policy that a command line names, of a run of these settings.

    Args:
      arguments: the command line.
      config: the run's settings.
      shown: the same on the task that the policy is looked at in, as `on_task` returns them; None:
        on the run's own.

    Raises:
      UsageError: the run holds no such seed, setting or checkpoint.
    """
    seed = config.seed if arguments.seed is None else arguments.seed
    (place,) = places(config.trainings, seed, arguments.setting or 0)
    iteration, everyone = load_named(arguments)
    named = {"seed": arguments.seed, "setting": arguments.setting}
    parts = [f"{name}{number}" for name, number in named.items() if number is not None]
    shown = shown or config
    other = None if shown is config else shown.task_at(1)["name"]
    name = file_name(str(config.schedule.steps_after(iteration)), *parts, other)
    return Chosen(config, config.trainings[place], iteration, everyone.of(place), name, shown)


def evaluation_key(training: Training) -> jax.Array:
    """Return the key of the episodes that are recorded of a training's policies."""
    return jax.random.key(training.seed + SEED_OFFSET)


def output(arguments: argparse.Namespace, folder: str, name: str) -> Path:
    """Return the file that --out names, or the one of that name in a folder of the run.

    A policy's file `x.policy` has such folders in `x`, beside it.

    Raises:
      OSError: the run's folder holds a link instead of that folder.
    """
    if arguments.out is not None:
        return arguments.out
    run_dir = arguments.run_dirs[0]
    within = (run_dir.with_suffix("") if is_policy(run_dir) else run_dir) / folder
    refuse_link(within)
    return within / name


def check_output(*paths: Path) -> None:
    """Check, before hours of work, that files can be written, and make the folder of the first.

    Raises:
      UsageError: naming the file that cannot be.
    """
    for path in paths:
        writable("--out", path)
    made(paths[0].parent)
