"""Pictures that a task draws itself."""

import imageio_ffmpeg
import jax
import numpy as np
import pytest
from brax.envs.base import State

from hitmdp_jax import Spec, UsageError
from hitmdp_jax.envs.spec import Box, Observation
from hitmdp_jax.video.film import WITHOUT_CLOCK, write_video
from hitmdp_jax.video.filmstrip import filmstrip, pictures
from hitmdp_jax.video.frames import Scene
from hitmdp_jax.video.pictures import fitted, painter_of


class Lamp:
    """A task without a clock, whose picture is as bright as its state says."""

    spec = Spec(Observation((4,)), Box.unlimited(1), episode_length=10)

    def draw(self, state):
        return np.full((2, 3, 3), state.pipeline_state, np.uint8)


@pytest.fixture
def seen(recorded):
    """The episodes of a lamp that grows by 20 a step, 5 more in the second episode."""
    nothing = np.zeros((10, 2))
    brightness = 20 * np.arange(10)[:, None] + np.array([0, 5])
    state = State(brightness, nothing, nothing, nothing)
    return recorded.replace(state=state, qpos=None, qvel=None)


def test_a_small_picture_grows_by_whole_numbers_in_the_middle_of_a_white_one():
    picture = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    large = fitted(picture, (9, 5))
    assert large.shape == (5, 9, 3)
    np.testing.assert_array_equal(large[:4, 2:6], picture.repeat(2, axis=0).repeat(2, axis=1))
    assert (large[4] == 255).all()
    assert (large[:, :2] == 255).all()
    assert (large[:, 6:] == 255).all()


def test_a_large_picture_shrinks_to_the_size():
    half = np.zeros((40, 80, 3), np.uint8)
    half[:, 40:] = 200
    small = fitted(half, (20, 20))
    np.testing.assert_array_equal(small[5:15, :10], 0)
    np.testing.assert_array_equal(small[5:15, 10:], 200)
    assert (small[:5] == 255).all()


def test_each_step_shows_the_state_of_its_own_episode(seen):
    scene = Scene(Lamp(), seen, 1)
    with painter_of(Lamp(), (30, 20)) as painter:
        assert [int(painter.paint(*scene.shown(t)).max()) for t in range(4)] == [5, 25, 45, 65]
    assert scene.moment(3) == "step 3"
    first = {step: int(picture[120, 160, 0]) for step, picture in pictures(Lamp(), seen).items()}
    assert first == {step: 20 * step for step in first}


def test_a_task_without_a_clock_is_filmed_step_by_step(seen, tmp_path):
    path = tmp_path / "lamp.mp4"
    write_video(path, Lamp(), seen, size=(96, 64))
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == 10 + 4
    assert seconds == pytest.approx(frames / WITHOUT_CLOCK, rel=0.05)
    labels = [axes.get_xlabel() for axes in filmstrip(Lamp(), seen).axes if axes.images]
    assert labels[:4] == ["step 0", "step 1", "step 2", "step 5"]  # those under option 0


def test_a_task_that_cannot_be_drawn_says_so():
    with pytest.raises(UsageError, match="no MuJoCo model and no method draw"):
        painter_of(object())


def test_slices_of_states_may_hold_random_keys(seen):
    keys = jax.random.split(jax.random.key(0), 20).reshape(10, 2)
    scene = Scene(Lamp(), seen.replace(state=seen.state.replace(info={"key": keys})), 1)
    assert scene.shown(3)[0].info["key"] == keys[3, 1]
