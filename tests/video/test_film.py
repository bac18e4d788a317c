import io

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.video import film
from hitmdp_jax.video.film import (
    BORDER,
    FOOTER,
    HEADER,
    MARGIN,
    Scene,
    animated,
    evenly,
    filmstrip,
    timing,
    write_video,
)

# Of imageio-ffmpeg's own process, by which the tests read a video.
pytestmark = pytest.mark.filterwarnings("ignore:os.fork")
SIZE = (96, 64)
OPTIONS = np.repeat([0, 2, 0, 1], [3, 2, 1, 4])  # of ten steps


@pytest.fixture(scope="module")
def env():
    return make_env("invertedpendulum", physics="native")


@pytest.fixture(scope="module")
def recorded():
    """Two episodes of ten steps and of four, in which the cart moves to the right."""
    T, N = 10, 2
    alive = np.stack([np.ones(T, bool), np.arange(T) < 4], axis=1)
    qpos = np.zeros((T, N, 2))
    qpos[..., 0] = np.linspace(-0.9, 0.9, T)[:, None]
    option = np.stack([OPTIONS, np.full(T, 3)], axis=1)
    fields = {
        "obs": np.zeros((T, N, 4)),
        "action": np.zeros((T, N, 1)),
        "reward": alive.astype(float),
        "option": option,
        "option_probs": None,
        "alive": alive,
        "control_steps": alive.astype(int),
        "terminated": np.array([False, True]),
        "qpos": qpos,
        "qvel": np.ones((T, N, 2)),
    }
    return Trajectories(**fields)


def read(path):
    """Return a video's frames, its frames a second and its codec and pixel format."""
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    width, height = about["size"]
    frames = [np.frombuffer(x, np.uint8).reshape(height, width, 3) for x in reader]
    return np.stack(frames), about


def rgb(k):
    return 255 * np.array(to_rgb(option_color(k)))


@pytest.mark.parametrize(
    ("dt", "every", "fps"), [(0.05, 1, 20), (0.01, 2, 50), (1 / 60, 1, 60), (0.008, 3, 125 / 3)]
)
def test_time_is_real_and_frames_are_at_most_sixty_a_second(dt, every, fps):
    assert timing(dt) == (every, pytest.approx(fps))


def test_a_video_plays_in_browsers_and_shows_every_episode_in_real_time(tmp_path, env, recorded):
    path = tmp_path / "a.mp4"
    write_video(path, env, recorded, size=SIZE)
    frames, about = read(path)
    assert (about["codec"], about["pix_fmt"].split("(")[0]) == ("h264", "yuv420p")
    assert about["fps"] == 25  # 0.04 s a step
    assert frames.shape == (10 + 4, HEADER + 64 + 2 * BORDER + FOOTER, 96 + 2 * BORDER, 3)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    # The border in the middle of its left side, as far as the codec keeps colours.
    border = frames[:, HEADER + 32, 2].astype(float)
    wanted = [rgb(k) for k in [*OPTIONS, 3, 3, 3, 3]]
    np.testing.assert_allclose(border, wanted, atol=25)


def test_a_video_begins_as_a_moving_picture(tmp_path, env, recorded):
    """Fourteen frames of 0.04 s are six of 0.1 s."""
    write_video(tmp_path / "a.mp4", env, recorded, size=SIZE)
    with Image.open(io.BytesIO(animated(tmp_path / "a.mp4"))) as gif:
        assert (gif.width, gif.n_frames, gif.info["duration"]) == (320, 6, 100)
        gif.seek(4)  # step 10 of 14, whose border is of option 3
        y = round((HEADER + 32) / (HEADER + 64 + 2 * BORDER + FOOTER) * gif.height)
        np.testing.assert_allclose(gif.convert("RGB").getpixel((8, y)), rgb(3), atol=30)
    with pytest.raises(UsageError, match=r"b.mp4' cannot be read: .*No such file"):
        animated(tmp_path / "b.mp4")


def test_one_episode_may_be_chosen(tmp_path, env, recorded):
    write_video(tmp_path / "a.mp4", env, recorded, episodes=[1], size=SIZE)
    assert len(read(tmp_path / "a.mp4")[0]) == 4


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
    np.testing.assert_allclose(strip[elsewhere], [rgb(k) for k in OPTIONS[elsewhere]], atol=1)


def test_a_policy_without_options_has_no_border_and_no_strip(tmp_path, env, recorded):
    scene = Scene(env, recorded.replace(option=None), 0)
    body = np.full((64, 96, 3), 7, np.uint8)
    frame = scene.frame(body, 4)
    assert frame.shape == (HEADER + 64, 96, 3)
    np.testing.assert_array_equal(frame[HEADER:], body)
    write_video(tmp_path / "a.mp4", env, recorded.replace(option=None), size=SIZE)
    assert read(tmp_path / "a.mp4")[0].shape == (14, HEADER + 64, 96, 3)


def test_the_numbers_above_are_of_the_step_shown(env, recorded, monkeypatch):
    written = []
    monkeypatch.setattr(
        film.ImageDraw.ImageDraw,
        "text",
        lambda self, place, text, *rest, **how: written.append(text),
    )
    Scene(env, recorded, 0, "episode 1 of 2").frame(np.zeros((480, 640, 3), np.uint8), 4)
    assert written == ["option 2", "0.16 s", "1.0 m/s", "return 5.0", "episode 1 of 2"]


def test_pictures_of_a_filmstrip_are_spread_evenly():
    np.testing.assert_array_equal(evenly(np.arange(8), 4), [1, 3, 5, 7])
    np.testing.assert_array_equal(evenly(np.array([3, 9]), 4), [3, 9])
    np.testing.assert_array_equal(evenly(np.arange(100), 1), [50])


def test_a_filmstrip_has_a_row_an_option_with_the_times_of_its_steps(env, recorded):
    figure = filmstrip(env, recorded, columns=3)
    rows = [figure.axes[i : i + 3] for i in (0, 3, 6)]
    times = {
        row[0].get_ylabel().split("\n")[0]: [axes.get_xlabel() for axes in row if axes.images]
        for row in rows
    }
    assert figure.axes[0].get_ylabel() == "option 0\n40% of steps\n2.0 at a time"
    # Steps 0, 1, 2 and 5 under option 0, of 0.04 s each.
    assert times == {
        "option 0": ["0.00 s", "0.08 s", "0.20 s"],
        "option 1": ["0.24 s", "0.32 s", "0.36 s"],
        "option 2": ["0.12 s", "0.16 s"],
    }


def test_a_filmstrip_without_options_is_of_the_whole_episode(env, recorded):
    figure = filmstrip(env, recorded.replace(option=None), episode=1, columns=2)
    assert [axes.get_xlabel() for axes in figure.axes] == ["0.04 s", "0.12 s"]


def test_what_is_missing_is_said(tmp_path, env, recorded, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"No such file or directory: .*nowhere/a.mp4'"):
        write_video(tmp_path / "nowhere" / "a.mp4", env, recorded, size=SIZE)

    def fail():
        raise RuntimeError

    for named in (fail, lambda: str(tmp_path / "ffmpeg")):
        monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", named)
        with pytest.raises(UsageError, match="There is no ffmpeg"):
            write_video(tmp_path / "a.mp4", env, recorded, size=SIZE)
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: "/bin/false")
    with pytest.raises(UsageError, match="cannot be written: '/bin/false' ended with 1"):
        write_video(tmp_path / "a.mp4", env, recorded, size=SIZE)
    monkeypatch.setattr(film.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="needs the extra 'video'"):
        write_video(tmp_path / "a.mp4", env, recorded, size=SIZE)
