"""Pictures of a task's states, in MuJoCo's own renderer, with a display or without."""

import copy
import functools
import importlib
import os
import subprocess
import sys

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context
from numpy.typing import ArrayLike

from hitmdp_jax.checks import check_size
from hitmdp_jax.errors import UsageError

BACKENDS = ("egl", "osmesa")  # of MuJoCo that need no display, in the order in which they are tried
SIZE = (640, 480)  # pixels, width and height
# Together these take six times as long as all the rest where there is no GPU. Haze would draw a
# white line along the horizon of an endless floor.
LEFT_OUT = ("mjRND_SHADOW", "mjRND_REFLECTION", "mjRND_HAZE")
SAMPLES = 0  # of anti-aliasing

MOST_PIXELS = 2**15  # of a side, more than libraries of graphics draw
DISTANCE = 0.8  # of a free camera, in diagonals of what it sees


class Painter:
    """Draws states of one model as the model's own camera, or one like it, sees them.

    Args:
      model: the compiled model; it is left as it is.
      size: width and height of a picture, pixels.

    Raises:
      UsageError: nothing can be drawn on this machine, or not in that size.
    """

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int] = SIZE):
        for side, pixels in zip(("width", "height"), size, strict=True):
            check_size(side, pixels, MOST_PIXELS)
        draw_without_display()
        model = copy.copy(model)
        screen, (width, height) = model.vis.global_, size
        screen.offwidth = max(screen.offwidth, width)
        screen.offheight = max(screen.offheight, height)
        model.vis.quality.offsamples = SAMPLES
        if not model.nlight:  # the headlight of MuJoCo's default is meant as an addition
            model.vis.headlight.diffuse[:] = 0.9
        endless_floor(model)
        self._model, self._data = model, mujoco.MjData(model)
        self._camera = camera(model)
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # every library of graphics fails in its own way
            reason = str(error).strip().splitlines() or [type(error).__name__]
            raise UsageError(
                f"MuJoCo cannot draw with MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}: {reason[0]}"
            ) from None
        for feature in LEFT_OUT:
            self._renderer.scene.flags[getattr(mujoco.mjtRndFlag, feature)] = False

    def paint(self, qpos: ArrayLike, qvel: ArrayLike) -> np.ndarray:
        """Return the picture [height, width, 3] of a state, 8 bits a colour."""
        self._data.qpos[:], self._data.qvel[:] = qpos, qvel
        mujoco.mj_forward(self._model, self._data)
        for _ in range(2):  # an endless floor lies where the camera was in the scene before
            self._renderer.update_scene(self._data, self._camera)
        return self._renderer.render()

    def close(self) -> None:
        """Give back what the graphics library holds."""
        self._renderer.close()

    def __enter__(self) -> "Painter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def check_drawing() -> None:
    """Check that pictures can be drawn on this machine; raises as `Painter`."""
    Painter(mujoco.MjModel.from_xml_string("<mujoco/>")).close()


@functools.cache
def draw_without_display() -> None:
    """Let MuJoCo draw off screen, by the first of `BACKENDS` that works here.

    MuJoCo reads MUJOCO_GL when it is imported; whoever has set it is left in charge. A library that
    fails spoils its process for the next one, so each is tried in a process of its own.

    Raises:
      UsageError: none works.
    """
    if "MUJOCO_GL" in os.environ or sys.platform != "linux":
        return
    for backend in BACKENDS:
        attempt = f"from mujoco.{backend} import GLContext as C; C(8, 8).make_current()"
        chosen = os.environ | {"MUJOCO_GL": backend}
        command = [sys.executable, "-c", attempt]
        if subprocess.run(command, env=chosen, capture_output=True).returncode == 0:
            os.environ["MUJOCO_GL"] = backend
            importlib.reload(gl_context)
            return
    raise UsageError(
        "MuJoCo cannot draw here: neither EGL nor OSMesa works. Install one of them (on Debian "
        "libegl1 and libgl1-mesa-dri, or libosmesa6), or set MUJOCO_GL."
    )


def camera(model: mujoco.MjModel) -> int | mujoco.MjvCamera:
    """Return the camera for a model.

    It is the model's first one that follows a body, else its first one fixed in the world, else a
    free one that sees everything but planes, and follows a body that can leave.
    """
    following = model.cam_mode == mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM
    fixed = (model.cam_mode == mujoco.mjtCamLight.mjCAMLIGHT_FIXED) & (model.cam_bodyid == 0)
    for own in (following, fixed):
        if own.any():
            return int(own.argmax())
    free = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, free)
    solid = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    if solid.any():
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        middle, radius = data.geom_xpos[solid], model.geom_rbound[solid, None]
        low, high = (middle - radius).min(axis=0), (middle + radius).max(axis=0)
        free.lookat[:], free.distance = (low + high) / 2, DISTANCE * np.linalg.norm(high - low)
    if roams(model):
        free.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        free.trackbodyid = model.jnt_bodyid[0]
    return free


def roams(model: mujoco.MjModel) -> bool:
    """Return whether the body can leave the place where it starts."""
    joint = forward_joint(model)
    return joint is not None and not model.jnt_limited[joint]


def endless_floor(model: mujoco.MjModel) -> None:
    """Draw, in place, the floor without an end where the body may run beyond it.

    Bodies collide with a plane everywhere, whatever its size; a cheetah soon runs where none is
    drawn. The texture keeps its size.
    """
    if not roams(model):
        return
    for plane in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        half_size, material = model.geom_size[plane, :2], model.geom_matid[plane]
        if material >= 0 and half_size.all() and not model.mat_texuniform[material]:
            model.mat_texrepeat[material] /= half_size
            model.mat_texuniform[material] = True
        half_size[:] = 0.0  # MuJoCo's word for infinite


def forward_joint(model: mujoco.MjModel) -> int | None:
    """Return the joint by which the body as a whole moves along x; None if it cannot."""
    for joint in range(model.njnt):
        free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        slide = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        along_x = np.allclose(model.jnt_axis[joint], (1.0, 0.0, 0.0))
        if model.jnt_bodyid[joint] == model.jnt_bodyid[0] and (free or (slide and along_x)):
            return joint
    return None


def forward_velocity(model: mujoco.MjModel, qvel: np.ndarray) -> np.ndarray | None:
    """Return the body's velocity along x [...], m/s, for qvel [..., nv]; None if it cannot move."""
    joint = forward_joint(model)
    return None if joint is None else qvel[..., model.jnt_dofadr[joint]]
