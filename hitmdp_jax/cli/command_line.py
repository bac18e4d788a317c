"""The command that trains what a run's settings say."""

import re
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.runs.config import GROUPS, RunConfig

SHOWN = ("physics", "seeds", "seed", "total_steps", "num_envs", "rollout_length")  # always
PLAIN = re.compile(r"[A-Za-z_][\w./-]*")  # a word that Hydra reads as it stands
WORDS = ("true", "false", "null", "inf", "nan")  # but for these


def command_line(config: RunConfig) -> str:
    """Return a command that trains what the settings say, as a shell reads it.

    It names whatever differs from what the rest of the command leads to: presets and tuned settings
    need no name.
    """
    if not config.tasks:
        return "hitmdp_jax.train, from Python"
    parts = [f"{group}={_text(getattr(config, group)['name'])}" for group in ("env", "algo")]
    if config.second_env is not None:
        parts = ["experiment=transfer", *parts]
    usual = dict(_settings(Settings(parts).config(trust=False)))
    for name, value in _settings(config):
        if name in SHOWN or name not in usual or usual[name] != value:
            parts.append(f"{name}={_text(value)}")
    return shlex.join(["python", "train.py", *parts])


def _settings(config: RunConfig) -> Iterator[tuple[str, Any]]:
    """Yield the settings by name, those of a task or algorithm each by its own."""
    settings = config.to_dict()
    for group in GROUPS:
        for name, value in (settings.pop(group) or {}).items():
            yield f"{group}.{name}", list(value) if isinstance(value, tuple) else value
    yield from settings.items()


def _text(value: Any) -> str:
    """Return a value as Hydra reads it."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{name}:{_text(x)}" for name, x in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_text, value)) + "]"
    if isinstance(value, str) and not (PLAIN.fullmatch(value) and value.lower() not in WORDS):
        escaped = value.replace("'", r"\'")
        return f"'{escaped}'"
    return str(value)
