import numpy as np
from matplotlib.colors import to_rgb

from hitmdp_jax.figures.style import option_color
from hitmdp_jax.video import frames
from hitmdp_jax.video.frames import FOOTER, HEADER, MARGIN, Scene
from tests.video.conftest import OPTIONS


def test_the_strip_shows_all_options_and_the_cursor_where_the_episode_stands(env, recorded):
    scene = Scene(env, recorded, 0)
    body = np.zeros((400, 600, 3), np.uint8)
    width, height = Scene.frame_size((600, 400), options=True)
    frame = scene.frame(body, 4).astype(float)
    assert frame.shape == (height, width, 3)
    middles = MARGIN + ((np.arange(10) + 0.5) / 10 * (width - 2 * MARGIN)).astype(int)
    strip = frame[height - FOOTER // 2, middles]
    np.testing.assert_allclose(strip[4], 0)  # the cursor
    elsewhere = np.arange(10) != 4
    colors = [255 * np.array(to_rgb(option_color(k))) for k in OPTIONS[elsewhere]]
    np.testing.assert_allclose(strip[elsewhere], colors, atol=1)


def test_a_policy_without_options_has_no_border_and_no_strip(env, recorded):
    scene = Scene(env, recorded.replace(option=None), 0)
    body = np.full((64, 96, 3), 7, np.uint8)
    frame = scene.frame(body, 4)
    assert frame.shape == (HEADER + 64, 96, 3)
    np.testing.assert_array_equal(frame[HEADER:], body)


def test_the_numbers_above_are_of_the_step_shown(env, recorded, monkeypatch):
    written = []
    monkeypatch.setattr(
        frames.ImageDraw.ImageDraw,
        "text",
        lambda self, place, text, *rest, **how: written.append(text),
    )
    Scene(env, recorded, 0, "episode 1 of 2").frame(np.zeros((480, 640, 3), np.uint8), 4)
    assert written == ["option 2", "0.16 s", "1.0 m/s", "return 5.0", "episode 1 of 2"]
