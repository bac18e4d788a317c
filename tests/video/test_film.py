import io

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.video import film
from hitmdp_jax.video.film import animated, timing, write_clips, write_video
from hitmdp_jax.video.frames import BORDER, FOOTER, HEADER
from tests.video.conftest import OPTIONS

# Of imageio-ffmpeg's own process, by which the tests read a video.
pytestmark = pytest.mark.filterwarnings("ignore:os.fork")
SIZE = (96, 64)


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


def test_one_episode_may_be_chosen_and_without_options_it_has_no_border(tmp_path, env, recorded):
    path = tmp_path / "a.mp4"
    write_video(path, env, recorded.replace(option=None), episodes=[1], size=SIZE)
    assert read(path)[0].shape == (4, HEADER + 64, 96, 3)


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


def picture(value):
    return np.full((2, 4, 3), value, np.uint8)


def test_films_side_by_side_last_as_long_as_the_longest():
    films = [iter([picture(1), picture(2), picture(3)]), iter([picture(7)]), iter([picture(8)] * 2)]
    seen = [[int(frame[0, 0, 0]) for frame in frames] for frames in film.together(films)]
    assert seen == [[1, 7, 8], [2, 7, 8], [3, 7, 8]]


def test_frames_stand_row_by_row_and_what_is_left_over_is_white():
    whole = film.grid([picture(1), picture(2), picture(3)], 2)
    assert whole.shape == (4, 8, 3)
    assert whole[::2, ::4, 0].tolist() == [[1, 2], [3, 255]]
    assert film.grid([picture(5)], 1).tolist() == picture(5).tolist()


def test_clips_are_of_one_length_and_have_the_colour_of_their_option(tmp_path, env, recorded):
    """Ten steps of 0.04 s and four: every third is a frame, and the shorter one stands still."""
    alone = [recorded.replace(option=np.full_like(recorded.option, k)) for k in (2, 5)]
    alone[1] = alone[1].replace(alive=recorded.alive & (np.arange(10) < 4)[:, None])
    paths = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    write_clips(paths, env, alone, size=SIZE)
    for path, k in zip(paths, (2, 5), strict=True):
        frames, about = read(path)
        assert about["fps"] == pytest.approx(1 / 0.12, abs=0.01)  # at most ten
        assert frames.shape == (4, 64 + 2 * BORDER, 96 + 2 * BORDER, 3)
        np.testing.assert_allclose(frames[:, 40, 3], [rgb(k)] * 4, atol=25)
    moved = [np.abs(np.diff(read(path)[0].astype(int), axis=0)).max((1, 2, 3)) for path in paths]
    assert (moved[0] > 50).all()
    assert (moved[1] > 50).tolist() == [True, False, False]


def test_a_video_of_several_shows_each_in_its_place(tmp_path, env, recorded):
    path = tmp_path / "a.mp4"
    film.write_side_by_side(path, env, [recorded, recorded], size=SIZE)
    frames, _ = read(path)
    width = 96 + 2 * BORDER
    assert frames.shape == (10, HEADER + 64 + 2 * BORDER + FOOTER, 2 * width, 3)
    for column in range(2):
        border = frames[:, HEADER + 32, column * width + 2].astype(float)
        np.testing.assert_allclose(border, [rgb(k) for k in OPTIONS], atol=25)
