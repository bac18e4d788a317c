"""The command that trains what a run's settings say."""

import shlex
from collections.abc import Iterator
from typing import Any

from hitmdp_jax.cli.overrides import written
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.runs.config import GROUPS, RunConfig

SHOWN = ("physics", "seeds", "seed", "total_steps", "num_envs", "rollout_length")  # always


def command_line(config: RunConfig) -> str:
    """Return a command that trains what the settings say, as a shell reads it.

    It names whatever differs from what the rest of the command leads to: presets and tuned settings
    need no name.
    """
    if not config.tasks:
        return "hitmdp_jax.train, from Python"
    parts = [f"{group}={written(getattr(config, group)['name'])}" for group in ("env", "algo")]
    if config.second_env is not None:
        parts = ["experiment=transfer", *parts]
    usual = dict(_settings(Settings(parts).config(trust=False)))
    for name, value in _settings(config):
        if name in SHOWN or name not in usual or usual[name] != value:
            parts.append(f"{name}={written(value)}")
    return shlex.join(["python", "train.py", *parts])


def _settings(config: RunConfig) -> Iterator[tuple[str, Any]]:
    """Yield the settings by name, those of a task or algorithm each by its own."""
    settings = config.to_dict()
    for group in GROUPS:
        for name, value in (settings.pop(group) or {}).items():
            yield f"{group}.{name}", list(value) if isinstance(value, tuple) else value
    yield from settings.items()
