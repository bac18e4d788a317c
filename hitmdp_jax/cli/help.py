"""What `train --help` says: every setting, its value and what configs/ says of it."""

import re
import shutil
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from hitmdp_jax.cli import tasks
from hitmdp_jax.cli.overrides import written
from hitmdp_jax.cli.settings import OWN, Settings, dotted

# "  name: value  # meaning", or "  - group: choice  # meaning" among the defaults
LINE = re.compile(r"( *)(- (?:optional |override )?)?([\w/]+):([^#]*)(?:# (.*))?")
CHOSEN = ("env.name", "algo.name", "second_env")  # by a group
NAMES = 34  # columns of a setting's name and value
USAGE = """usage: hitmdp train [-m] [name=value ...]

Train an agent. `python train.py` does the same. If you do not name a setting, it has the value
that is shown below. Add env=, algo= and other groups to --help to see the settings of these.

Flags:
  -m, --multirun  one run for each combination of listed values, such as algo=mopg,ppo
  -h, --help      this text
  --cfg=job       print the settings of a run and stop; --hydra-help lists Hydra's other flags
"""


def text(settings: Settings) -> str:
    """Return the help for what a command line names; of several jobs, for the first one's."""
    job = settings.jobs()[0]
    values, known = settings.values(job), meanings(settings, job)
    env, algo = values["env"]["name"], values["algo"]["name"]
    parts = {
        "Choices, GROUP=CHOICE": _choices(settings, known),
        f"Settings of env={env}": _settings(values, known, "env."),
        f"Settings of algo={algo}": _settings(values, known, "algo."),
        "Settings of every run": _settings(values, known, ""),
    }
    lines = [line for title, rows in parts.items() for line in ("", f"{title}:", *_table(rows))]
    return "\n".join([USAGE.rstrip(), *lines])


def meanings(settings: Settings, job: list[str]) -> dict[str, str]:
    """Return the meaning of each group and each setting of a job, by name.

    Files of one's own, and tasks of other libraries, do not say what theirs mean.
    """
    values = settings.values(job)
    found = comments((settings.folder / "config").with_suffix(".yaml"))
    for name in values["algo"]["name"], OWN:
        if (file := settings.folder / "algo" / f"{name}.yaml").is_file():
            return found | comments(file, "algo.") | _keywords(values)
    return found


def comments(file: Path, group: str = "") -> dict[str, str]:
    """Return the comments behind a file's settings, by the settings' full names; "" for none.

    Args:
      file: one of configs/.
      group: what the names begin with, such as "algo.", where the file does not say it itself.
    """
    lines = file.read_text(encoding="utf-8").splitlines()
    path = [] if lines[0] == "# @package _global_" or not group else [group.rstrip(".")]
    top, found = len(path), {}
    for indent, item, name, value, comment in (m.groups() for m in map(LINE.fullmatch, lines) if m):
        path[top + len(indent) // 2 :] = [name]
        if value:  # else what lies below it has values
            found[name if item else ".".join(path)] = comment or ""
    return found


def _keywords(values: Mapping[str, Any]) -> dict[str, str]:
    return {f"env.{name}": text for name, text in tasks.keywords(values["env"]["name"]).items()}


def _choices(settings: Settings, known: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for group in (name for name in known if name in settings.groups):
        yield group, f"{known[group]}: {', '.join(sorted(settings.groups[group]))}"


def _settings(
    values: Mapping[str, Any], known: Mapping[str, str], group: str
) -> Iterator[tuple[str, str]]:
    """Yield the settings of a group, and those of no group for "", each with what it means."""
    given = {name: x for name, x in dotted(values) if name not in CHOSEN}
    for name in {**given, **known}:
        if name.startswith(group) if group else "." not in name and name in given:
            yield (f"{name}={written(given[name])}" if name in given else name), known.get(name, "")


def _table(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    width = max(60, shutil.get_terminal_size().columns)
    for name, meaning in rows:
        first, *rest = textwrap.wrap(meaning, width - NAMES) or [""]
        yield f"  {name:<{NAMES - 3}} {first}".rstrip()
        yield from (f"{'':{NAMES}}{line}" for line in rest)
