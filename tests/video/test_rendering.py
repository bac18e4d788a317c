import os

import numpy as np
import pytest

from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.assets import load_model
from hitmdp_jax.errors import UsageError
from hitmdp_jax.video import rendering
from hitmdp_jax.video.rendering import Painter, camera, forward_velocity

BALL = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    {camera}
    <body name="ball">{joint}<geom size="0.3" rgba="1 0 0 1"/></body>
  </worldbody>
</mujoco>
"""
FIXED = '<camera pos="0 -3 0" xyaxes="1 0 0 0 0 1"/>'


def ball(joint, camera=""):
    return load_model(BALL.format(joint=joint, camera=camera))


def test_a_picture_shows_where_the_body_is():
    model = ball('<joint type="slide" axis="1 0 0"/>', FIXED)
    with Painter(model, (64, 48)) as painter:
        left, right = (painter.paint([x], [0.0]) for x in (-0.8, 0.8))
    assert (left.shape, left.dtype) == ((48, 64, 3), np.uint8)
    redness = [picture[..., 0].astype(int) - picture[..., 1] for picture in (left, right)]
    columns = [np.average(np.arange(64), weights=red.clip(0).sum(axis=0)) for red in redness]
    assert columns[0] < 24
    assert columns[1] > 40


def test_a_picture_may_be_larger_than_the_model_plans_for():
    with Painter(ball("<freejoint/>"), (800, 600)) as painter:
        assert painter.paint(np.eye(7)[3], np.zeros(6)).shape == (600, 800, 3)


def test_the_floor_has_no_end():
    model = make_env("halfcheetah", physics="native").model
    with Painter(model, (64, 48)) as painter:
        start, far = (painter.paint([x, *np.zeros(8)], np.zeros(9))[-8:] for x in (0.0, 500.0))
    assert start.std() > 40  # squares, black and white
    assert far.std() > 40


@pytest.mark.parametrize(
    ("name", "own"),
    [("halfcheetah", "track"), ("dmc/cheetah_run", "side"), ("dmc/reacher_easy", "fixed")],
)
def test_a_task_is_seen_through_its_own_camera(name, own):
    model = make_env(name, physics="native").model
    assert model.camera(camera(model)).name == own


@pytest.mark.parametrize(
    ("joint", "followed"),
    [
        ("<freejoint/>", True),
        ('<joint type="slide" axis="1 0 0"/>', True),
        ('<joint type="slide" axis="1 0 0" range="-1 1" limited="true"/>', False),
        ('<joint type="hinge"/>', False),
    ],
)
def test_without_a_camera_a_body_that_can_leave_is_followed(joint, followed):
    model = ball(joint)
    assert (camera(model).trackbodyid == model.body("ball").id) == followed


@pytest.mark.parametrize(
    ("name", "place"), [("halfcheetah", 0), ("dmc/walker_walk", 1), ("ant", 0), ("reacher", None)]
)
def test_speed_is_along_x_where_the_body_can_move(name, place):
    model = make_env(name, physics="native").model
    speed = forward_velocity(model, np.arange(2 * model.nv).reshape(2, -1))
    assert speed is None if place is None else speed.tolist() == [place, model.nv + place]


def test_a_users_choice_is_left_as_it_is(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    rendering.draw_without_display.cache_clear()
    rendering.draw_without_display()
    assert os.environ["MUJOCO_GL"] == "glfw"


def test_a_machine_that_cannot_draw_says_so(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(rendering, "BACKENDS", ("nothing",))
    rendering.draw_without_display.cache_clear()
    with pytest.raises(UsageError, match="neither EGL nor OSMesa works"):
        rendering.draw_without_display()


def test_a_choice_that_fails_says_so(monkeypatch):
    def fail(*args):
        raise RuntimeError("no display\nat all")

    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(rendering.mujoco, "Renderer", fail)
    with pytest.raises(UsageError, match=r"MuJoCo cannot draw with MUJOCO_GL=glfw: no display$"):
        rendering.check_drawing()
