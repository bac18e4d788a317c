"""How every command line reads settings, and how it says what is wrong with them."""

import argparse
import copy
import functools
import itertools
import logging
import os
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import hydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

import hitmdp_jax
from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError, exit_with, out_of_domain, unknown_name
from hitmdp_jax.training.config import RunConfig, trust_named

HOST_SETTINGS = (
    "resume",
    "run_dir",
    "overwrite",
    "report",
    "distributed",
    "trust",
)  # of the command line, not of the run
OWN_GROUPS = ("env", "algo")  # whose choice may be path/to/file.py:Class
OWN = "own"  # the choice that stands for it


def configs() -> Path:
    """Return the folder of settings, which a wheel brings as well."""
    return Path(hitmdp_jax.__file__).parent / "configs"


def guarded(command: Callable[[], int | None]) -> None:
    """Run a command line: one sentence and exit code 2 where its user or the disk is at fault."""
    threading.excepthook = _say_in_a_line
    logging.getLogger("absl").setLevel(logging.CRITICAL)  # what Orbax logs, `Checkpoints` says
    try:
        code = command()
    except UsageError as error:
        exit_with(error)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # who read it has gone
        sys.exit(1)
    except OSError as error:
        if error.filename is None:
            raise  # not a file's fault
        exit_with(UsageError(f"'{error.filename}' cannot be used: {error.strerror}."))
    if code:
        sys.exit(code)


def dispatched(usage: Callable[[], str], command: Callable[[str, list[str]], int]) -> None:
    """Run a command line `NAME [argument ...]`; without a name, print its usage."""

    def run() -> int:
        arguments = sys.argv[1:]
        if not arguments or {"-h", "--help"} & set(arguments):
            print(usage())
            return 0
        return command(arguments[0], arguments[1:])

    guarded(run)


def _say_in_a_line(args: threading.ExceptHookArgs) -> None:
    """Report what ended a thread that writes in the background: a full disk needs no traceback."""
    if isinstance(args.exc_value, OSError):
        print(f"warning: {args.exc_value}", file=sys.stderr)
    else:
        threading.__excepthook__(args)


class Parser(argparse.ArgumentParser):
    """A parser of flags, of a command that reads runs, that says what is wrong as all of them do.

    Args:
      **arguments: as `argparse.ArgumentParser`.
    """

    def __init__(self, **arguments: Any):
        super().__init__(**arguments)
        self.add_argument("--trust", action="store_true", help="run the files that a run names")

    def error(self, message: str) -> NoReturn:
        """Raise UsageError, of which `guarded` makes one sentence."""
        raise UsageError(f"{message[0].upper()}{message[1:]}; --help lists what can be given.")


class Settings:
    """The settings of one command line, read and checked.

    Args:
      arguments: `name=value`; flags (`-m`, `--help`) are Hydra's own and left alone.
      multirun: whether a value may be a list of choices, `a,b`, for one run each.

    Raises:
      UsageError: an argument cannot be read, or names no setting or no choice of a group.
    """

    def __init__(self, arguments: Sequence[str], multirun: bool = False):
        self.folder = configs()
        groups = {p.name: _choices(p) for p in self.folder.iterdir() if p.is_dir()}
        parsed = [_parse(text) for text in arguments]
        own = {
            override.key_or_group
            for override in parsed
            if override.key_or_group in OWN_GROUPS and plugins.is_own(str(override.value()))
        }
        self.overrides: list[str] = []  # as Hydra reads them
        names = []
        for override in parsed:
            name = override.get_key_element().lstrip("+~")
            text = override.input_line or ""
            if name in own:
                path = plugins.absolute(str(override.value()))
                self.overrides += [f"{name}={OWN}", f"++{name}.name='{path}'"]
            elif name.split(".")[0] in own:
                self.overrides.append(f"++{text.lstrip('+')}")
            else:
                self.overrides.append(text)
                names.append((name, override))
        self._check(names, groups, multirun)

    def _check(
        self, names: list[tuple[str, Override]], groups: dict[str, list[str]], multirun: bool
    ) -> None:
        values = []
        for name, override in names:
            if override.is_sweep_override() and not multirun:
                raise UsageError(
                    f"'{override.input_line}' lists several values: add -m to run one after the "
                    "other."
                )
            if name.startswith("hydra"):
                continue
            if name in groups:
                for choice in _listed(override):
                    if choice not in groups[name]:
                        kind = {"env": "environment"}.get(name, name)
                        raise unknown_name(kind, choice, groups[name])
            else:
                values.append(name)
        chosen = [o for o in self.overrides if _parse(o).get_key_element().lstrip("+~") in groups]
        known = [name for job in _product(chosen) for name in _dotted(self._compose(job))]
        for name in values:
            if name not in known:
                raise unknown_name("setting", name, set(known))

    def jobs(self) -> list[list[str]]:
        """Return the overrides of every run: one, or one for each combination of listed values.

        Of a range, from which a sweeper such as Optuna's draws, the two ends stand for all.
        """
        return _product(self.overrides)

    def swept(self) -> list[str]:
        """Return the names of the settings that list several values."""
        parsed = map(_parse, self.overrides)
        return [o.get_key_element() for o in parsed if o.is_sweep_override()]

    def values(self, job: Sequence[str] | None = None) -> dict[str, Any]:
        """Return every setting of a job by name, interpolations resolved.

        Raises:
          UsageError: Hydra cannot compose them.
        """
        return self._compose(self.overrides if job is None else job)

    def config(self, job: Sequence[str] | None = None, trust: bool = True) -> RunConfig:
        """Return a job's validated settings; `trust` and Raises as `run_config`."""
        return run_config(self.values(job), trust)

    def _compose(self, overrides: Sequence[str]) -> dict[str, Any]:
        return copy.deepcopy(_composed(self.folder.absolute(), tuple(overrides)))


@functools.lru_cache(maxsize=64)  # a command line asks for the same settings several times
def _composed(folder: Path, overrides: tuple[str, ...]) -> dict[str, Any]:
    with hydra.initialize_config_dir(str(folder), version_base="1.3"):
        try:
            composed = hydra.compose("config", overrides=list(overrides))
            values = OmegaConf.to_container(composed, resolve=True)
        except (HydraException, OmegaConfBaseException) as error:
            raise UsageError(" ".join(str(error).split())) from error
    assert isinstance(values, dict)
    return {str(name): x for name, x in values.items()}


def run_config(values: dict[str, Any], trust: bool = True) -> RunConfig:
    """Return a run's validated settings among a command line's values.

    Args:
      values: every setting by name.
      trust: run the files that they name, and remember that this user's command line named them.

    Raises:
      UsageError: as `RunConfig.from_mapping`.
    """
    if trust:
        trust_named(values, remember=True)
    return RunConfig.from_mapping({k: v for k, v in values.items() if k not in HOST_SETTINGS})


def folder_setting(values: dict[str, Any], name: str = "run_dir") -> Path | None:
    """Return a folder that was named, or None.

    Raises:
      UsageError: the name is empty, or no name.
    """
    value = values.get(name)
    if value is None:
        return None
    named = isinstance(value, str | int | float) and not isinstance(value, bool)
    if not named or not str(value).strip():
        raise UsageError(f"{name} = {value!r} names no folder.")
    return Path(str(value)).expanduser()


def flag_setting(values: dict[str, Any], name: str) -> bool:
    """Return a setting that is true or false.

    Raises:
      UsageError: it is neither.
    """
    value = values.get(name, False)
    if not isinstance(value, bool):
        raise out_of_domain(name, value, "true or false")
    return value


def _parse(text: str) -> Override:
    wrong = UsageError(f"'{text}' is not of the form name=value, e.g. env=halfcheetah.")
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException:
        raise wrong from None
    if not override.key_or_group or override.is_delete():  # every setting is needed
        raise wrong
    return override


def _listed(override: Override) -> list[str]:
    if override.is_sweep_override():
        return [str(x) for x in override.sweep_string_iterator()]
    return [str(override.value())]


def _product(overrides: Sequence[str]) -> list[list[str]]:
    """Return one list of overrides for each combination of listed values."""
    lists = []
    for override in map(_parse, overrides):
        key, text = override.get_key_element(), override.input_line or ""
        swept = override.is_sweep_override()
        if override.is_interval_sweep():
            ends: Any = override.value()
            lists.append([f"{key}={ends.start}", f"{key}={ends.end}"])
        elif swept:
            lists.append([f"{key}={x}" for x in override.sweep_string_iterator()])
        else:
            lists.append([text])
    return [list(job) for job in itertools.product(*lists)]


def _choices(group: Path) -> list[str]:
    names = [str(p.relative_to(group).with_suffix("")) for p in group.rglob("*.yaml")]
    return [name for name in names if name != OWN]  # which only a path stands for


def _dotted(tree: Any, prefix: str = "") -> list[str]:
    if not isinstance(tree, dict):
        return [prefix]
    return [
        name for key, x in tree.items() for name in _dotted(x, f"{prefix}.{key}" if prefix else key)
    ]
