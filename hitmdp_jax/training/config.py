"""A run's settings: validated once, then frozen."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from hitmdp_jax.agents import AGENTS, Agent
from hitmdp_jax.agents.base import check_hyperparameters
from hitmdp_jax.envs import check_env
from hitmdp_jax.envs.physics import ENGINES
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name
from hitmdp_jax.training.program import check_sizes, num_iterations

REPORT_STEPS = 2048
POSITIVE = ("seeds", "total_steps", "num_envs", "rollout_length", "checkpoint_steps")


@dataclasses.dataclass(frozen=True)
class RunConfig:
    """What `train.py` runs. The fields mirror configs/config.yaml, where each is explained."""

    env: dict[str, Any]  # name, version and the task's keywords
    algo: dict[str, Any]  # name and the agent's hyperparameters
    physics: str
    seeds: int
    seed: int
    total_steps: int
    num_envs: int
    rollout_length: int
    checkpoint_steps: int
    second_env: dict[str, Any] | None = None  # the task a transfer switches to

    @classmethod
    def from_mapping(cls, settings: Mapping[str, Any]) -> "RunConfig":
        """Validate settings before anything is compiled.

        Raises:
          UsageError: a setting is unknown, out of its domain, or does not divide.
        """
        fields = {field.name for field in dataclasses.fields(cls)}
        for name in settings:
            if name not in fields:
                raise unknown_name("setting", name, fields)
        values = dict(settings)
        for name in POSITIVE:
            values[name] = _whole(name, values[name], at_least=1)
        values["seed"] = _whole("seed", values["seed"], at_least=0)
        if values["physics"] not in ENGINES:
            raise unknown_name("physics", str(values["physics"]), ENGINES)
        config = cls(**values)
        for task in config.tasks:
            check_env(**task)
        check_sizes(config.make_agent(), config.total_steps, config.num_envs, config.rollout_length)
        return config

    def make_agent(self) -> Agent:
        """Return the agent that `algo` describes.

        Raises:
          UsageError: the algorithm or a hyperparameter is unknown or out of range.
        """
        hyperparameters = dict(self.algo)
        name = hyperparameters.pop("name")
        if name not in AGENTS:
            raise unknown_name("algo", str(name), AGENTS)
        fields = {field.name: field for field in dataclasses.fields(AGENTS[name])}
        for key, value in hyperparameters.items():
            if key not in fields:
                raise unknown_name(f"hyperparameter of {name}", key, fields)
            hyperparameters[key] = _like(f"algo.{key}", value, fields[key].default)
        agent = AGENTS[name](**hyperparameters)
        check_hyperparameters(agent)
        return agent

    @property
    def tasks(self) -> list[dict[str, Any]]:
        """The tasks trained on, one after the other, `total_steps` each."""
        return [self.env] if self.second_env is None else [self.env, self.second_env]

    @property
    def task_title(self) -> str:
        """What is trained on."""
        return ", then ".join(task["name"] for task in self.tasks)

    @property
    def title(self) -> str:
        """What is trained on what."""
        return f"{self.algo['name']} on {self.task_title}"

    @property
    def switch_at(self) -> int | None:
        """Environment steps of each seed after which a transfer goes on to its second task."""
        return None if self.second_env is None else self.iterations * self.steps_per_iteration

    @property
    def iterations_per_report(self) -> int:
        """Iterations between two reports: one, or as many as make up 2048 environment steps."""
        return max(1, REPORT_STEPS // self.steps_per_iteration)

    @property
    def iterations(self) -> int:
        """Iterations spent on each task, a whole number of reports."""
        needed = num_iterations(self.total_steps, self.num_envs, self.rollout_length)
        return -(-needed // self.iterations_per_report) * self.iterations_per_report

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of one seed in one iteration."""
        return self.num_envs * self.rollout_length

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as `from_mapping` takes them."""
        return dataclasses.asdict(self)

    def save(self, path: Path) -> None:
        """Write the settings as YAML."""
        path.write_text(yaml.safe_dump(self.to_dict(), sort_keys=False))

    @classmethod
    def load(cls, run_dir: Path) -> "RunConfig":
        """Read a run's settings.

        Raises:
          UsageError: the folder holds no run.
        """
        path = run_dir / "config.yaml"
        if not path.is_file():
            raise UsageError(f"'{run_dir}' is not a run's folder: it has no config.yaml.")
        return cls.from_mapping(yaml.safe_load(path.read_text()))


def _whole(name: str, value: Any, at_least: int) -> int:
    """Return a whole number, which may be written as 1e6."""
    wanted = "a positive whole number" if at_least else "a whole number from 0"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise out_of_domain(name, value, wanted)
    if value != int(value) or value < at_least:
        raise out_of_domain(name, value, wanted)
    return int(value)


def _like(name: str, value: Any, default: Any) -> Any:
    """Return a value in the type of the field's default."""
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise out_of_domain(name, value, "true or false")
    elif isinstance(default, int):
        return _whole(name, value, at_least=1)
    elif isinstance(default, float):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise out_of_domain(name, value, "a number")
        return float(value)
    elif isinstance(default, tuple):
        if not isinstance(value, list | tuple):
            raise out_of_domain(name, value, "a list of positive whole numbers")
        return tuple(value)
    return value
