"""The command line of `train.py`: Hydra's settings in, one sentence out where they are wrong."""

import re
import sys
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hitmdp_jax.errors import UsageError, exit_with, unknown_name
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.host import set_up_host

RESUMABLE = ("resume", "total_steps")  # what may stand on a command line that resumes a run


def main(config_dir: Path) -> None:
    """Run the command line.

    Args:
      config_dir: the folder of Hydra's settings.
    """
    arguments = sys.argv[1:]
    try:
        if not {"-h", "--help", "--hydra-help"} & set(arguments):
            check_overrides([a for a in arguments if not a.startswith("-")], config_dir.absolute())
    except UsageError as error:
        exit_with(error)
    hydra.main(version_base="1.3", config_path=str(config_dir.absolute()), config_name="config")(
        _run
    )()


def _run(settings: DictConfig) -> None:
    """Train as the composed settings say."""
    try:
        values: dict[str, Any] = OmegaConf.to_container(settings, resolve=True)  # pyright: ignore
        resume, run_dir = values.pop("resume"), Path(values.pop("run_dir"))
        if resume is None:
            config = RunConfig.from_mapping(values)
        else:
            run_dir = Path(resume)
            config = _resumed(run_dir, HydraConfig.get().overrides.task, values["total_steps"])
        from hitmdp_jax.training.loop import run

        set_up_host(config.physics, config.num_envs, config.seeds)
        run(config, run_dir, resume=resume is not None)
    except UsageError as error:
        exit_with(error)


def _resumed(run_dir: Path, overrides: list[str], total_steps: Any) -> RunConfig:
    """Return the settings a resumed run goes on with."""
    names = [override.split("=")[0] for override in overrides]
    for name in names:
        if name not in RESUMABLE:
            raise UsageError(
                f"resume={run_dir} goes on with the run's own settings; only total_steps can be "
                f"changed, not '{name}'."
            )
    config = RunConfig.load(run_dir)
    if "total_steps" not in names:
        return config
    return RunConfig.from_mapping(config.to_dict() | {"total_steps": total_steps})


def check_overrides(overrides: list[str], config_dir: Path) -> None:
    """Explain what is wrong with a command line in one sentence, before Hydra reads it.

    Args:
      overrides: the command line's `name=value` arguments.
      config_dir: the folder of Hydra's settings.

    Raises:
      UsageError: an argument cannot be read, or names no setting or no choice of a group.
    """
    groups = {p.name: _choices(p) for p in config_dir.iterdir() if p.is_dir()}
    parser = OverridesParser.create()
    chosen, values = [], []
    for text in overrides:
        try:
            override = parser.parse_override(text)
        except HydraException:
            raise UsageError(
                f"'{text}' is not of the form name=value, e.g. env=halfcheetah."
            ) from None
        name = override.get_key_element().lstrip("+~")
        if override.is_sweep_override() or name.startswith("hydra"):
            continue
        if name in groups:
            choice = str(override.value())
            if choice not in groups[name]:
                kind = {"env": "environment"}.get(name, name)
                raise unknown_name(kind, choice, groups[name])
            chosen.append(text)
        else:
            values.append((name, text))
    known = _known_settings(chosen, config_dir)
    for name, _ in values:
        if name not in known:
            raise unknown_name("setting", name, known)


def _choices(group: Path) -> list[str]:
    return [str(p.relative_to(group).with_suffix("")) for p in group.rglob("*.yaml")]


def _known_settings(groups: list[str], config_dir: Path) -> list[str]:
    """Return the dotted names of all settings under the chosen groups."""
    with hydra.initialize_config_dir(str(config_dir), version_base="1.3"):
        try:
            composed = hydra.compose("config", overrides=groups)
        except (HydraException, OmegaConfBaseException) as error:
            raise UsageError(re.sub(r"\s+", " ", str(error))) from error
    return list(_dotted(OmegaConf.to_container(composed)))


def _dotted(tree: Any, prefix: str = "") -> list[str]:
    if not isinstance(tree, dict):
        return [prefix]
    return [
        name for key, x in tree.items() for name in _dotted(x, f"{prefix}.{key}" if prefix else key)
    ]
