"""Compiling models, most of them other packages' own, with the small edits MuJoCo needs."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

import mujoco

from hitmdp_jax.errors import UsageError
from hitmdp_jax.physics.base import CONTACTS

GYMNASIUM_ASSETS = ("gymnasium", "envs/mujoco/assets")
ALL = -1.0


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


def load_model(
    source: Path | str, edit: Callable[[mujoco.MjSpec], None] | None = None
) -> mujoco.MjModel:
    """Compile a MuJoCo model from XML.

    Args:
      source: the path of an XML file, which may include others; or the XML itself, "<mujoco>...".
      edit: changes the specification before it is compiled.

    Raises:
      UsageError: there is no such file.
    """
    if str(source).lstrip().startswith("<"):
        spec = mujoco.MjSpec.from_string(str(source))
    elif Path(source).is_file():
        spec = mujoco.MjSpec.from_file(str(source))
    else:
        raise UsageError(f"There is no model file '{source}'.")
    if edit is not None:
        edit(spec)
    _number_first(spec, CONTACTS, ALL)
    # MuJoCo 4 warns about this attribute, on the terminal and in a log file, at every load; scaling
    # the compiled model's masses is what the attribute does.
    total_mass, spec.compiler.settotalmass = spec.compiler.settotalmass, -1
    model = spec.compile()
    if total_mass > 0:
        mujoco.mj_setTotalmass(model, total_mass)
        mujoco.mj_setConst(model, mujoco.MjData(model))
    switch_off_idle_stages(model)
    return model


def _number_first(spec: mujoco.MjSpec, name: str, value: float) -> None:
    """Add a custom number before those that the model has, unless it has this one.

    MJX 3.17 takes a number's place in the list for its place among all values: behind numbers of
    several values it would read one of theirs.
    """
    others = list(spec.numerics)
    if name in (number.name for number in others):
        return
    kept = [{"name": n.name, "data": list(n.data), "size": n.size} for n in others]
    for number in others:
        spec.delete(number)
    for number in ({"name": name, "data": [value]}, *kept):
        spec.add_numeric(**number)


def switch_off_idle_stages(model: mujoco.MjModel) -> None:
    """Spare MuJoCo C, in place, the stages that leave a lone robot's motion as it is to the bit.

    Dividing the constraints into islands, which pays where many bodies move apart, takes up to 7 %
    of a step; looking for contacts that the collision filter rules out, a fifth.
    """
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    if not can_touch(model):
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT


def can_touch(model: mujoco.MjModel) -> bool:
    """Return whether MuJoCo's collision filter lets any two geoms of a model through."""
    meet = model.geom_contype[:, None] & model.geom_conaffinity != 0
    body = model.body_weldid[model.geom_bodyid]
    return model.npair > 0 or bool((meet & (body[:, None] != body)).any())
