"""A run's settings: validated once, then frozen."""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hitmdp_jax import plugins
from hitmdp_jax.agents import Agent, find_agent
from hitmdp_jax.agents.base import hyperparameters_of
from hitmdp_jax.checks import divisor_below, true_or_false, whole_number
from hitmdp_jax.envs import check_engine, check_env, check_installed
from hitmdp_jax.envs.keywords import defaults_of
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name
from hitmdp_jax.physics import find_engine
from hitmdp_jax.reading import read_yaml
from hitmdp_jax.runs.folder import CONFIG, is_policy, require_run
from hitmdp_jax.runs.schedule import Schedule
from hitmdp_jax.training.sizes import check_sizes
from hitmdp_jax.training.sweep import PREFIX, Training, apart, check_sweep, settings_of
from hitmdp_jax.training.warm_start import check_parts

SCHEMA = 3  # of config.yaml; raised where an older package would misread it
WHOLE = {  # name -> the least value
    "seeds": 1,
    "total_steps": 1,
    "num_envs": 1,
    "rollout_length": 1,
    "data_devices": 1,
    "checkpoint_steps": 1,
    "eval_every": 0,
    "eval_episodes": 1,
    "video_every": 0,
    "seed": 0,
}
GROUPS = ("algo", "env", "second_env")  # of settings, each with a name
WANDB = ("off", "program", "seed")
Task = dict[str, Any]  # a task's name, version and keywords, as `make_env` takes them
BESIDE_THE_POINT = (
    "data_devices",
    "checkpoint_steps",
    "save_replay",
    "eval_every",
    "eval_episodes",
    "video_every",
    "wandb",
)


@dataclasses.dataclass(frozen=True)
class RunConfig:
    """What `train.py` runs. The fields mirror configs/config.yaml, where each is explained.

    All but the algorithm have defaults, so that a run of an older version, which had fewer
    settings, can still be read.
    """

    algo: dict[str, Any]  # name and the agent's hyperparameters
    env: dict[str, Any] | None = None  # name, version and keywords; None: saved from Python
    physics: str = "mjx"
    seeds: int = 1
    seed: int = 0
    total_steps: int = 1_000_000
    num_envs: int = 16
    rollout_length: int = 128
    data_devices: int = 1
    checkpoint_steps: int = 250_000
    save_replay: bool = False
    eval_every: int = 0
    eval_episodes: int = 20
    video_every: int = 0
    wandb: str = "off"
    second_env: dict[str, Any] | None = None  # the task a transfer switches to
    sweep: dict[str, Any] | None = None
    samples: int | None = None
    init_from: str | None = None  # a run's folder, or a policy's file, whose path is absolute
    init_parts: tuple[str, ...] | None = None
    callbacks: tuple[str, ...] | None = None  # path/to/file.py:Class of each
    stop_at_return: float | None = None

    @classmethod
    def from_mapping(cls, settings: Mapping[str, Any]) -> "RunConfig":
        """Validate settings before anything is compiled.

        Raises:
          UsageError: a setting is unknown, out of its domain, or does not divide.
        """
        fields = {field.name: field for field in dataclasses.fields(cls)}
        for name in settings:
            if name not in fields:
                raise unknown_name("setting", str(name), fields)
        values = dict(settings)
        if values.get("samples") is not None:
            values["samples"] = whole_number("samples", values["samples"], 1)
        for name in set(WHOLE) & set(values):
            values[name] = whole_number(name, values[name], WHOLE[name])
        # wandb=off is a bool to YAML
        wandb = values.get("wandb", "off")
        values["wandb"] = "off" if wandb is False else wandb
        if values["wandb"] not in WANDB:
            raise unknown_name("wandb", str(values["wandb"]), WANDB)
        values["init_parts"] = _parts(values.get("init_from"), values.get("init_parts"))
        values["callbacks"] = _callbacks(values.get("callbacks"))
        if (least := values.get("stop_at_return")) is not None:
            values["stop_at_return"] = _like("stop_at_return", least, 0.0)
        true_or_false("save_replay", values.get("save_replay", False))
        for name in GROUPS:
            given = values.get(name)
            if given is None and name != "algo":
                continue
            names = list(given) if isinstance(given, Mapping) else []
            if "name" not in names or not all(isinstance(key, str) for key in names):
                raise UsageError(f"{name} = {given} must hold a name and its settings.")
        config = cls(**values)
        if config.seed + config.seeds > 2**32:
            raise out_of_domain("seed", config.seed, "a whole number below 2^32 - seeds")
        _check_division(config.num_envs, config.data_devices)
        engine, made_by = find_engine(config.physics), []
        for task in config.tasks:
            made_by.append(check_env(**task))
            check_engine(task["name"], engine)
            if task.get("action_repeat", 1) != config.action_repeat:
                raise UsageError("The tasks of a transfer must have the same action_repeat.")
        agent = config.make_agent()
        check_sizes(agent, config.total_steps, config.num_envs, config.rollout_length)
        check_sweep(config.sweep, config.samples, agent, made_by)
        for setting in config.settings:
            config.make_agent(setting)
        return config

    def check_installed(self) -> None:
        """Check that what the engine and the tasks need is installed; settings can do without.

        Raises:
          UsageError: an extra is missing.
        """
        find_engine(self.physics).check()
        for task in self.tasks:
            check_installed(task["name"])

    def make_agent(self, swept: Mapping[str, float] | None = None) -> Agent:
        """Return the agent that `algo` describes, under a setting of what the run sweeps.

        Raises:
          UsageError: the algorithm or a hyperparameter is unknown or out of range.
        """
        hyperparameters = self.algo | apart(swept or {})[0]
        name = str(hyperparameters.pop("name"))
        agent = find_agent(name)
        fields = {field.name: field for field in hyperparameters_of(agent)}
        for key, value in hyperparameters.items():
            if key not in fields:
                raise unknown_name(f"hyperparameter of {plugins.label(name)}", str(key), fields)
            hyperparameters[key] = _like(f"algo.{key}", value, fields[key].default)
        return agent(**hyperparameters)  # pyright: ignore[reportArgumentType]

    @property
    def agents(self) -> Agent:
        """The agents of all trainings: what is swept of their hyperparameters is [R]."""
        return self.make_agent().replace(**apart(self.swept)[0])

    @functools.cached_property
    def settings(self) -> list[dict[str, float]]:
        """The settings of what the run sweeps; a single empty one where it sweeps nothing."""
        return settings_of(self.sweep, self.samples, self.seed)

    @property
    def swept(self) -> dict[str, np.ndarray]:
        """What is swept, [R] each: a hyperparameter by its name, a task's number as `env.name`."""
        return {
            name.removeprefix(PREFIX): np.array([t.swept[name] for t in self.trainings], np.float32)
            for name in self.sweep or {}
        }

    @functools.cached_property
    def trainings(self) -> list[Training]:
        """The run's trainings, in the order of its arrays' first axis: all seeds of a setting."""
        return [
            Training(self.seed + i, number, swept)
            for number, swept in enumerate(self.settings)
            for i in range(self.seeds)
        ]

    @property
    def tasks(self) -> list[Task]:
        """The tasks trained on, one after the other, `total_steps` each."""
        return [task for task in (self.env, self.second_env) if task is not None]

    @property
    def task_title(self) -> str:
        """What is trained on."""
        return ", then ".join(plugins.label(task["name"]) for task in self.tasks)

    @property
    def title(self) -> str:
        """What is trained on what."""
        return f"{plugins.label(self.algo['name'])} on {self.task_title}"

    @functools.cached_property
    def schedule(self) -> Schedule:
        """How far the run goes, and what falls due after which iteration."""
        steps = self.num_envs * self.rollout_length * self.action_repeat
        return Schedule(self.total_steps, steps, self.checkpoint_steps, len(self.tasks))

    @property
    def switch_at(self) -> int | None:
        """Environment steps of each seed after which a transfer goes on to its second task."""
        return self.schedule.switch_at

    @property
    def action_repeat(self) -> int:
        """Control steps that each action is held for; all of them count as environment steps."""
        return (self.env or {}).get("action_repeat", 1)

    def task_at(self, iteration: int, training: Training | None = None) -> Task:
        """Return the task that the iteration of that number, from 1, is on.

        It is also the task that a checkpoint of that iteration is scored, filmed and exported on.

        Args:
          iteration: its number.
          training: whose setting the task has, where the run sweeps numbers of it; None takes
            those that the run's settings give.

        Raises:
          UsageError: the run names no task.
        """
        if not self.tasks:
            raise UsageError("The run was saved from Python and names no task.")
        task = self.tasks[self.schedule.task_at(iteration)]
        return task if training is None else task | apart(training.swept)[1]

    def differences(self, other: "RunConfig") -> list[str]:
        """Return the settings that make two runs' results differ, `name: here, there` each."""
        mine, others = (dict(_dotted(config._in_full())) for config in (self, other))
        names = [*mine, *(name for name in others if name not in mine)]
        return [
            f"{name}: {mine.get(name)} here, {others.get(name)} there"
            for name in names
            if mine.get(name) != others.get(name) and name not in BESIDE_THE_POINT
        ]

    def _in_full(self) -> dict[str, Any]:
        """Return the settings with those of tasks and algorithm that an older package lacked.

        What is new takes its default, by which nothing changes.
        """
        algo = {
            field.name: list(field.default) if isinstance(field.default, tuple) else field.default
            for field in hyperparameters_of(find_agent(str(self.algo["name"])))
        }
        tasks = {
            name: {"action_repeat": 1} | defaults_of(check_env(**task)) | task
            for name in ("env", "second_env")
            if (task := getattr(self, name)) is not None
        }
        return self.to_dict() | tasks | {"algo": algo | self.algo}

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as `from_mapping` takes them."""
        return dataclasses.asdict(self)

    def to_yaml(self) -> str:
        """Return the settings as config.yaml holds them."""
        return yaml.safe_dump({"schema": SCHEMA} | self.to_dict(), sort_keys=False)

    @classmethod
    def load(cls, run_dir: Path, trust: bool = False) -> "RunConfig":
        """Read a run's settings; what an older version did not have yet takes its default.

        Args:
          run_dir: the run's folder, or the file of a single policy.
          trust: run the files of tasks and algorithms that the settings name, whoever made them.

        Raises:
          UsageError: the folder holds no run, or one that cannot be read; or it names a file that
            nobody here trusts (`plugins`).
        """
        require_run(run_dir)
        if is_policy(run_dir):
            from hitmdp_jax.runs.policy_file import read_policy  # a run's settings need no Orbax

            return cls.read(read_policy(run_dir).settings, run_dir, trust)
        path = run_dir / CONFIG
        return cls.read(read_yaml(path), path, trust)

    @classmethod
    def read(cls, settings: Any, path: Path, trust: bool = False) -> "RunConfig":
        """Return the settings that a file holds; `path` names it, the rest is as `load`."""
        if not isinstance(settings, dict):
            raise UsageError(f"'{path}' cannot be read: it does not hold a run's settings.")
        schema = settings.pop("schema", SCHEMA)
        if schema != SCHEMA:
            age = "an older" if isinstance(schema, int) and schema < SCHEMA else "a newer"
            raise UsageError(
                f"'{path}' was written by {age} hitmdp_jax (schema {schema}), which this one, of "
                f"schema {SCHEMA}, cannot read."
            )
        try:
            if trust:
                trust_named(settings)
            return cls.from_mapping(settings)
        except UsageError as error:
            raise UsageError(f"'{path}' cannot be used: {error}") from None


def trust_named(settings: Mapping[str, Any], remember: bool = False) -> None:
    """Trust the files that a run's settings name; args and Raises as `plugins.trust`."""
    for group in GROUPS:
        chosen = settings.get(group)
        if isinstance(chosen, Mapping):
            plugins.trust(str(chosen.get("name")), remember)
    callbacks = settings.get("callbacks")
    for name in callbacks if isinstance(callbacks, list | tuple) else (callbacks,):
        plugins.trust(str(name), remember)


def _check_division(num_envs: int, data_devices: int) -> None:
    if num_envs % data_devices:
        near = divisor_below(num_envs, data_devices)
        raise UsageError(
            f"num_envs = {num_envs} is not divisible by data_devices = {data_devices}; the nearest "
            f"number below that divides it is {near}."
        )


def _callbacks(names: Any) -> tuple[str, ...] | None:
    """Return the names of callbacks; their files are run by who trains, and nobody else."""
    if names is None:
        return None
    listed = tuple(names) if isinstance(names, list | tuple) else (names,)
    for name in listed:
        if not isinstance(name, str) or not plugins.is_own(name):
            plugins.require_class(str(name))
            raise out_of_domain("callbacks", name, "a file and its class, as [my.py:MyCallback]")
    return listed


def _parts(init_from: Any, init_parts: Any) -> tuple[str, ...] | None:
    if init_from is not None and not isinstance(init_from, str):
        raise out_of_domain("init_from", init_from, "a run's folder, or a policy's file")
    if init_parts is not None and init_from is None:
        raise UsageError(f"init_parts = {init_parts} has no effect: init_from names no run.")
    return None if init_parts is None else check_parts(init_parts)


def _like(name: str, value: Any, default: Any) -> Any:
    """Return a value in the type of the field's default."""
    if isinstance(default, bool):
        return true_or_false(name, value)
    if isinstance(default, int):
        return whole_number(name, value, at_least=1)
    if isinstance(default, float):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise out_of_domain(name, value, "a number")
        return float(value)
    if isinstance(default, tuple):
        return tuple(value) if isinstance(value, list) else value
    return value


def _dotted(tree: Any, prefix: str = "") -> list[tuple[str, Any]]:
    if not isinstance(tree, dict):
        return [(prefix, list(tree) if isinstance(tree, tuple) else tree)]
    return [
        pair for key, x in tree.items() for pair in _dotted(x, f"{prefix}.{key}" if prefix else key)
    ]
