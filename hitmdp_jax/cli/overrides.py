"""One `name=value` of a command line: how Hydra reads it, and what it lists."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString, Transformer, ValueType
from hydra.errors import HydraException

from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError

OWN_GROUPS = ("env", "algo")  # whose choice may be path/to/file.py:Class
# Whose value is taken as it is, whatever letters it has.
PATHS = ("run_dir", "resume", "init_from", "init_parts")
MOST_JOBS = 10_000  # of -m
WORD = re.compile(r"[A-Za-z_][\w./-]*")  # which Hydra reads as it stands
CONSTANTS = ("true", "false", "null", "inf", "nan")  # but for these


def parse(text: str) -> Override:
    """Return what Hydra makes of an argument.

    Raises:
      UsageError: it is not of the form `name=value`.
    """
    wrong = UsageError(f"'{text}' is not of the form name=value, e.g. env=halfcheetah.")
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException:
        raise wrong from None
    if not override.key_or_group or override.is_delete():  # every setting is needed
        raise wrong
    return override


def with_quoted_path(text: str, multirun: bool) -> str:
    """Return an argument in which a path is quoted, but for a list of them that -m takes."""
    name, _, value = text.partition("=")
    is_path = name in PATHS or (name in OWN_GROUPS and plugins.is_own(value))
    in_brackets = name == "init_parts" and value[:1] == "["  # elsewhere it may begin a path
    listed = value in ("true", "false") or in_brackets or (multirun and "," in value)
    return f"{name}={quoted(value)}" if is_path and not listed else text


def check_form(parsed: Sequence[Override], multirun: bool) -> None:
    """Raise UsageError where a setting is given twice, or has several values without -m."""
    given: dict[str, Override] = {}
    for override in parsed:
        name, text = override.get_key_element().lstrip("+~"), override.input_line
        if name in given:
            raise UsageError(f"'{given[name].input_line}' and '{text}' set {name} twice.")
        if override.is_sweep_override() and not multirun:
            raise UsageError(f"'{text}' lists several values: add -m to run them in turn.")
        if override.value_type is ValueType.GLOB_CHOICE_SWEEP:
            raise UsageError(f"'{text}' is a pattern: list the choices, as {name}=a,b.")
        given[name] = override
    swept = given["sweep"].value() if "sweep" in given else None
    for name in set(swept if isinstance(swept, dict) else ()) & set(given):
        raise UsageError(
            f"'{given[name].input_line}' has no effect: sweep= gives {name} its values."
        )


def is_own(override: Override) -> bool:
    """Return whether a group's choice is a file and a class of it, or all of several choices.

    Raises:
      UsageError: some are, and others are not.
    """
    if override.key_or_group not in OWN_GROUPS:
        return False
    for choice in listed(override):
        plugins.require_class(choice)
    own = [plugins.is_own(choice) for choice in listed(override)]
    if any(own) and not all(own):
        raise UsageError(
            f"'{override.input_line}' mixes files of your own with other names: run -m once for "
            "each kind."
        )
    return all(own)


def listed(override: Override) -> list[str]:
    """Return the values that a setting lists, its only one otherwise."""
    if override.is_sweep_override() and not override.is_interval_sweep():
        elements = override.sweep_iterator(Transformer.identity)
        return [x.text if isinstance(x, QuotedString) else str(x) for x in elements]
    return [str(override.value())]


def product(overrides: Sequence[str]) -> list[list[str]]:
    """Return one list of overrides for each combination of listed values.

    Raises:
      UsageError: there are more than anyone would run.
    """
    lists = []
    for override in map(parse, overrides):
        key, text = override.get_key_element(), override.input_line or ""
        swept = override.is_sweep_override()
        if override.is_interval_sweep():
            ends: Any = override.value()
            lists.append([f"{key}={ends.start}", f"{key}={ends.end}"])
        elif swept:
            values = itertools.islice(override.sweep_string_iterator(), MOST_JOBS + 1)
            lists.append([f"{key}={x}" for x in values])
        else:
            lists.append([text])
    if math.prod(map(len, lists)) > MOST_JOBS:
        raise UsageError(f"-m lists more than {MOST_JOBS:,} jobs.")
    return [list(job) for job in itertools.product(*lists)]


def name_of(override: str) -> str:
    """Return the name of the setting in `name=value`, or `++name=value`."""
    return override.partition("=")[0].lstrip("+~")


def quoted(value: str) -> str:
    """Return a value as Hydra reads it letter for letter, such as a path with a space or a comma.

    What is quoted already, and `null`, stays as it is.
    """
    if value in ("", "null") or re.fullmatch(r"'.*'|\".*\"", value, re.DOTALL):
        return value
    return "'" + re.sub(r"(\\*)('|$)", lambda m: 2 * m[1] + (m[2] and "\\'"), value) + "'"


def written(value: Any) -> str:
    """Return a value as Hydra reads it."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{name}:{written(x)}" for name, x in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(written, value)) + "]"
    if isinstance(value, str) and not (WORD.fullmatch(value) and value.lower() not in CONSTANTS):
        escaped = value.replace("'", r"\'")
        return f"'{escaped}'"
    return str(value)
