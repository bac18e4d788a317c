"""All settings of one command line, composed by Hydra and checked name by name."""

import copy
import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

import hitmdp_jax
from hitmdp_jax import plugins
from hitmdp_jax.cli import tasks
from hitmdp_jax.cli.overrides import (
    check_form,
    is_own,
    listed,
    name_of,
    parse,
    product,
    quoted,
    with_quoted_path,
)
from hitmdp_jax.cli.run_settings import run_config
from hitmdp_jax.errors import UsageError, unknown_name

if TYPE_CHECKING:  # it imports all that trains, which takes seconds
    from hitmdp_jax.runs.config import RunConfig

OWN = "own"  # the choice that stands for a file of one's own
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
        parsed = [parse(with_quoted_path(text, multirun)) for text in arguments]
        check_form(parsed, multirun)
        own = {o.key_or_group for o in parsed if is_own(o)}
        self.overrides: list[str] = []  # as Hydra reads them
        names = []
        for override in parsed:
            name = override.get_key_element().lstrip("+~")
            text = override.input_line or ""
            if name in own:
                paths = [quoted(plugins.absolute(choice)) for choice in listed(override)]
                self.overrides += [f"{name}={OWN}", f"++{name}.name={','.join(paths)}"]
            else:
                # The keywords of a task are known once its class is, which `run_config` imports.
                added = name.startswith("env.") or name.split(".")[0] in own
                self.overrides.append(("++" if added else "") + text.lstrip("+"))
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
                for choice in listed(override):
                    if choice not in groups[name]:
                        kind = {"env": "environment"}.get(name, name)
                        raise unknown_name(kind, choice, groups[name], listed=HELP)
        chosen = [o for o in self.overrides if name_of(o) in groups]
        jobs = product(chosen)
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
            for choice in set(listed(override)) - set(known):
                if package := HYDRA_GROUPS[name].get(choice):
                    raise UsageError(f"{name}={choice} is not installed: pip install {package}.")
                raise unknown_name(name, choice, {*known, *HYDRA_GROUPS[name]})

    def jobs(self) -> list[list[str]]:
        """Return the overrides of every run: one, or one for each combination of listed values.

        Of a range, from which a sweeper such as Optuna's draws, the two ends stand for all.
        """
        return product(self.overrides)

    def swept(self) -> list[str]:
        """Return the names of the settings that list several values."""
        return [name_of(o) for o in self.overrides if parse(o).is_sweep_override()]

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
        """Return what Hydra composes of the choices of groups, with the values set in a copy.

        Hydra needs 0.1 s for the first step, so it is done once for each set of choices.
        """
        groups = self.groups
        choices = [o for o in overrides if name_of(o) in groups or o.startswith("hydra")]
        others = [parse(o) for o in overrides if o not in choices]
        try:
            composed = copy.deepcopy(_composed(self.folder.absolute(), tuple(choices)))
            for other in others:
                name, value = other.get_key_element().lstrip("+"), other.value()
                OmegaConf.update(composed, name, value, force_add=other.is_force_add())
            values = OmegaConf.to_container(composed, resolve=True)
        except (HydraException, OmegaConfBaseException) as error:
            raise UsageError(" ".join(str(error).split())) from error
        assert isinstance(values, dict)
        return {str(name): x for name, x in values.items()}


@functools.lru_cache(maxsize=64)  # jobs and errors ask for the same choices
def _composed(folder: Path, choices: tuple[str, ...]) -> DictConfig:
    with hydra.initialize_config_dir(str(folder), version_base="1.3"):
        return hydra.compose("config", overrides=list(choices))


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
