"""How every command line reads settings, and how it says what is wrong with them."""

import copy
import functools
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hydra
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString, Transformer, ValueType
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

import hitmdp_jax
from hitmdp_jax import plugins
from hitmdp_jax.checks import true_or_false
from hitmdp_jax.cli import tasks
from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.runs.folder import check_replaceable

if TYPE_CHECKING:  # it imports all that trains, which takes seconds
    from hitmdp_jax.runs.config import RunConfig

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
# Whose value is taken as it is, whatever letters it has.
PATHS = ("run_dir", "resume", "init_from", "init_parts")
MOST_JOBS = 10_000  # of -m
WORD = re.compile(r"[A-Za-z_][\w./-]*")  # which Hydra reads as it stands
CONSTANTS = ("true", "false", "null", "inf", "nan")  # but for these
HELP = "python train.py --help"  # which lists groups, choices and settings
# Of Hydra's own settings those that a run with -m heeds; the group -> the choices that an
# installation adds, and how.
HYDRA_GROUPS = {
    "hydra/launcher": dict.fromkeys(("submitit_local", "submitit_slurm"), "'hitmdp-jax[slurm]'"),
    "hydra/sweeper": {"optuna": "hydra-optuna-sweeper"},
}


def configs() -> Path:
    """Return the folder of settings, which a wheel brings as well."""
    return Path(hitmdp_jax.__file__).parent / "configs"


class Settings:
    """The settings of one command line, read and checked.

    Args:
      arguments: `name=value`; flags (`-m`, `--help`) are Hydra's own and left alone.
      multirun: whether a value may be a list of choices, `a,b`, for one run each.

    Raises:
      UsageError: an argument cannot be read, or names no setting or no choice of a group.
    """

    def __init__(self, arguments: Sequence[str], multirun: bool = False):
        self.folder, self.multirun = configs(), multirun
        self.groups = {p.name: _choices(p) for p in self.folder.iterdir() if p.is_dir()}
        self.groups["env"] += tasks.store_tasks()
        parsed = [_parse(_literal(text, multirun)) for text in arguments]
        _check_form(parsed, multirun)
        own = {o.key_or_group for o in parsed if _is_own(o)}
        self.overrides: list[str] = []  # as Hydra reads them
        names = []
        for override in parsed:
            name = override.get_key_element().lstrip("+~")
            text = override.input_line or ""
            if name in own:
                paths = [quoted(plugins.absolute(choice)) for choice in _listed(override)]
                self.overrides += [f"{name}={OWN}", f"++{name}.name={','.join(paths)}"]
            else:
                # The keywords of a task are known once its class is, which `run_config` imports.
                added = name.startswith("env.") or name.split(".")[0] in own
                self.overrides.append(f"++{text.lstrip('+')}" if added else text)
                if name.split(".")[0] not in own:
                    names.append((name, override))
        self._check(names)

    def _check(self, names: list[tuple[str, Override]]) -> None:
        values, groups = [], self.groups
        for name, override in names:
            if name.startswith("hydra"):
                self._check_hydra(name, override)
            elif name not in groups:
                values.append(name)
            else:
                for choice in _listed(override):
                    if choice not in groups[name]:
                        kind = {"env": "environment"}.get(name, name)
                        raise unknown_name(kind, choice, groups[name], listed=HELP)
        chosen = [o for o in self.overrides if name_of(o) in groups]
        jobs = _product(chosen)
        known = {*groups, *(name for job in jobs for name in self.names(job))}
        if not known.issuperset(values):
            chosen = {self.values(job)["env"]["name"] for job in jobs}
            known |= {f"env.{keyword}" for name in chosen for keyword in tasks.keywords(name)}
        for name in values:
            if name not in known:
                raise unknown_name("setting", name, known, listed=HELP)

    def _check_hydra(self, name: str, override: Override) -> None:
        """Let through what decides how the jobs of -m run; nothing else of Hydra's has a say."""
        of_group = any(name.startswith(group.replace("/", ".") + ".") for group in HYDRA_GROUPS)
        if not self.multirun or override.is_add() or not (of_group or name in HYDRA_GROUPS):
            instead = " run_dir= names the folder." if name.endswith(".dir") else ""
            raise UsageError(
                f"'{name}' has no effect here: of Hydra's own settings, -m takes hydra/launcher, "
                f"hydra/sweeper and what belongs to them.{instead}"
            )
        if name in HYDRA_GROUPS:
            with hydra.initialize_config_dir(str(self.folder.absolute()), version_base="1.3"):
                known = GlobalHydra.instance().config_loader().get_group_options(name)
            for choice in set(_listed(override)) - set(known):
                if package := HYDRA_GROUPS[name].get(choice):
                    raise UsageError(f"{name}={choice} is not installed: pip install {package}.")
                raise unknown_name(name, choice, {*known, *HYDRA_GROUPS[name]})

    def jobs(self) -> list[list[str]]:
        """Return the overrides of every run: one, or one for each combination of listed values.

        Of a range, from which a sweeper such as Optuna's draws, the two ends stand for all.
        """
        return _product(self.overrides)

    def swept(self) -> list[str]:
        """Return the names of the settings that list several values."""
        return [name_of(o) for o in self.overrides if _parse(o).is_sweep_override()]

    def values(self, job: Sequence[str] | None = None) -> dict[str, Any]:
        """Return every setting of a job by name, interpolations resolved.

        Of a task's keywords those are among them that were given a value.

        Raises:
          UsageError: Hydra cannot compose them.
        """
        return self._compose(self.overrides if job is None else job)

    def config(self, job: Sequence[str] | None = None, trust: bool = True) -> "RunConfig":
        """Return a job's validated settings; `trust` and Raises as `run_config`."""
        return run_config(self.values(job), trust)

    def names(self, job: Sequence[str]) -> list[str]:
        """Return the names of a job's settings."""
        return [name for name, _ in dotted(self._compose(job))]

    def _compose(self, overrides: Sequence[str]) -> dict[str, Any]:
        """Compose the choices of groups, then set values in a copy: Hydra's own two steps."""
        groups = self.groups
        choices = [o for o in overrides if name_of(o) in groups or o.startswith("hydra")]
        others = [_parse(o) for o in overrides if o not in choices]
        try:
            composed = copy.deepcopy(_composed(self.folder.absolute(), tuple(choices)))
            ConfigLoaderImpl._apply_overrides_to_config(others, composed)
            values = OmegaConf.to_container(composed, resolve=True)
        except (HydraException, OmegaConfBaseException) as error:
            sentence = " ".join(str(error).split())  # + is for what does not exist
            raise UsageError(sentence.partition(" To append to your config")[0]) from error
        assert isinstance(values, dict)
        return {str(name): x for name, x in values.items()}


@functools.lru_cache(maxsize=64)  # jobs and errors ask for the same choices, 0.1 s each
def _composed(folder: Path, choices: tuple[str, ...]) -> DictConfig:
    with hydra.initialize_config_dir(str(folder), version_base="1.3"):
        return hydra.compose("config", overrides=list(choices))


def writable(name: str, path: Path, within: str = "") -> Path:
    """Return a path that is to be written after hours of work, having made sure now that it can be.

    Args:
      name: the setting or flag that names it.
      path: a file or, of a folder, what `within` is a file of.
      within: the file's name.

    Raises:
      UsageError: it cannot be written.
    """
    try:
        check_replaceable(path / within)
    except NotADirectoryError:
        raise UsageError(f"{name} = {path} cannot be written: a file is in its way.") from None
    except OSError as error:
        raise UsageError(f"{name} = {path} cannot be written: {error.strerror}.") from None
    return path


def run_config(values: dict[str, Any], trust: bool = True) -> "RunConfig":
    """Return a run's validated settings among a command line's values.

    A task's keywords that were given no value have their defaults there.

    Args:
      values: every setting by name.
      trust: run the files that they name, and remember that this user's command line named them.

    Raises:
      UsageError: as `RunConfig.from_mapping`.
    """
    from hitmdp_jax.runs.config import RunConfig, trust_named

    if isinstance(names := values.get("callbacks"), list | str):
        listed = [names] if isinstance(names, str) else names
        own = [
            plugins.absolute(x) if isinstance(x, str) and plugins.is_own(x) else x for x in listed
        ]
        values = values | {"callbacks": own}
    if trust:
        trust_named(values, remember=True)
    values = {name: x for name, x in values.items() if name not in HOST_SETTINGS}
    if (source := folder_setting(values, "init_from")) is not None:
        values["init_from"] = str(source.absolute())
    values["env"] = task_setting(values)
    return RunConfig.from_mapping(values)


def task_setting(values: Mapping[str, Any]) -> Any:
    """Return the task among a command line's values, its keywords in full; if it is one."""
    task = values["env"]
    named = isinstance(task, dict) and isinstance(task.get("name"), str)
    return tasks.defaults(task["name"]) | task if named else task


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
    try:
        str(value).encode()
    except UnicodeEncodeError:  # whatever writes checkpoints takes no other names
        raise UsageError(
            f"{name} = {value!a} cannot be read as UTF-8 here: set LC_ALL=C.UTF-8, or name "
            "another folder."
        ) from None
    try:
        return Path(str(value)).expanduser()
    except RuntimeError:
        raise UsageError(
            f"{name} = {value} begins with the home folder of an unknown user."
        ) from None


def flag_setting(values: dict[str, Any], name: str) -> bool:
    """Return a setting that is true or false.

    Raises:
      UsageError: it is neither.
    """
    return true_or_false(name, values.get(name, False))


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


def name_of(override: str) -> str:
    """Return the name of the setting in `name=value`, or `++name=value`."""
    return override.partition("=")[0].lstrip("+~")


def _literal(text: str, multirun: bool) -> str:
    """Return an argument in which a path is quoted, but for a list of them that -m takes."""
    name, _, value = text.partition("=")
    is_path = name in PATHS or (name in OWN_GROUPS and plugins.is_own(value))
    in_brackets = name == "init_parts" and value[:1] == "["  # elsewhere it may begin a path
    listed = value in ("true", "false") or in_brackets or (multirun and "," in value)
    return f"{name}={quoted(value)}" if is_path and not listed else text


def _parse(text: str) -> Override:
    wrong = UsageError(f"'{text}' is not of the form name=value, e.g. env=halfcheetah.")
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException:
        raise wrong from None
    if not override.key_or_group or override.is_delete():  # every setting is needed
        raise wrong
    return override


def _check_form(parsed: Sequence[Override], multirun: bool) -> None:
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


def _is_own(override: Override) -> bool:
    """Return whether a group's choice is a file and a class of it, or all of several choices.

    Raises:
      UsageError: some are, and others are not.
    """
    if override.key_or_group not in OWN_GROUPS:
        return False
    for choice in _listed(override):
        plugins.require_class(choice)
    own = [plugins.is_own(choice) for choice in _listed(override)]
    if any(own) and not all(own):
        raise UsageError(
            f"'{override.input_line}' mixes files of your own with other names: run -m once for "
            "each kind."
        )
    return all(own)


def _listed(override: Override) -> list[str]:
    """Return the values that a setting lists, its only one otherwise."""
    if override.is_sweep_override() and not override.is_interval_sweep():
        elements = override.sweep_iterator(Transformer.identity)
        return [x.text if isinstance(x, QuotedString) else str(x) for x in elements]
    return [str(override.value())]


def _product(overrides: Sequence[str]) -> list[list[str]]:
    """Return one list of overrides for each combination of listed values.

    Raises:
      UsageError: there are more than anyone would run.
    """
    lists = []
    for override in map(_parse, overrides):
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


def _choices(group: Path) -> list[str]:
    names = [str(p.relative_to(group).with_suffix("")) for p in group.rglob("*.yaml")]
    return [name for name in names if name != OWN]  # which only a path stands for


def dotted(tree: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the settings that mappings within each other hold, by their full names."""
    if not isinstance(tree, dict):
        yield prefix, tree
    else:
        for name, x in tree.items():
            yield from dotted(x, f"{prefix}.{name}" if prefix else name)
