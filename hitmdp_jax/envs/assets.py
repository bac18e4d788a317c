"""Compiling the models that other packages ship, with the small edits MuJoCo needs."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

import mujoco

from hitmdp_jax.errors import UsageError

GYMNASIUM_ASSETS = ("gymnasium", "envs/mujoco/assets")


def asset_path(package: str, *parts: str) -> Path:
    """Return the path of a file inside an installed package, without importing the package.

    Raises:
      UsageError: the package is not installed.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise UsageError(f"The Python package '{package}' is not installed.")
    return Path(spec.submodule_search_locations[0]).joinpath(*parts)


def load_gymnasium_model(
    filename: str, edit: Callable[[mujoco.MjSpec], None] | None = None
) -> mujoco.MjModel:
    """Compile one of Gymnasium's MuJoCo models.

    Args:
      filename: the file's name, e.g. "half_cheetah.xml".
      edit: changes the specification before it is compiled.
    """
    return load_model(asset_path(*GYMNASIUM_ASSETS, filename), edit)


def load_model(path: Path, edit: Callable[[mujoco.MjSpec], None] | None = None) -> mujoco.MjModel:
    """Compile the MuJoCo model in a file and the files it includes.

    Args:
      path: the XML file.
      edit: changes the specification before it is compiled.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    if edit is not None:
        edit(spec)
    # MuJoCo 4 warns about this attribute, on the terminal and in a log file, at every load; scaling
    # the compiled model's masses is what the attribute does.
    total_mass, spec.compiler.settotalmass = spec.compiler.settotalmass, -1
    model = spec.compile()
    if total_mass > 0:
        mujoco.mj_setTotalmass(model, total_mass)
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
