import io

import numpy as np
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.util import img_mime_type_detector

from hitmdp_jax.runs.sinks import TensorboardSink
from hitmdp_jax.runs.sinks.tensorboard import write_pictures
from hitmdp_jax.training.sweep import Training
from tests.probes import trainings

METRICS = {"a_metric": np.array([0.5, 1.5]), "episode_return": np.array([np.nan, 7.0])}


def test_means_and_deviations_are_read_back(tmp_path):
    sink = TensorboardSink(tmp_path, trainings())
    sink.write(1, 2048, METRICS)
    sink.close()
    events = EventAccumulator(str(tmp_path)).Reload()
    assert events.Scalars("task/a_metric")[0].value == 1.0
    assert events.Scalars("task/a_metric_std")[0].value == 0.5
    assert events.Scalars("return/episode_return")[0].step == 2048


def test_resuming_keeps_the_points_before_and_repeats_none(tmp_path):
    """A run killed at iteration 3, whose checkpoint is of iteration 2."""
    sink = TensorboardSink(tmp_path, trainings())
    for i in (1, 2, 3):
        sink.write(i, 2048 * i, METRICS)
    sink.close()
    sink = TensorboardSink(tmp_path, trainings(), resume_after=2 * 2048)
    for i in (3, 4):
        sink.write(i, 2048 * i, METRICS)
    sink.close()
    events = EventAccumulator(str(tmp_path)).Reload()
    assert [e.step for e in events.Scalars("task/a_metric")] == [2048 * i for i in (1, 2, 3, 4)]


def test_what_was_flushed_outlives_the_process(tmp_path):
    """Nobody closes the events of a killed run."""
    sink = TensorboardSink(tmp_path, trainings())
    sink.write(1, 2048, METRICS)
    sink.flush()
    events = EventAccumulator(str(tmp_path)).Reload()
    assert [e.step for e in events.Scalars("task/a_metric")] == [2048]
    sink.close()


def test_the_settings_of_a_sweep_are_runs_of_their_own(tmp_path):
    swept = [Training(seed, i, {"algo.gamma": 0.9 + i / 20}) for i in (0, 1) for seed in (0, 1)]
    sink = TensorboardSink(tmp_path, swept)
    sink.write(1, 2048, {"a_metric": np.array([0.0, 1.0, 2.0, np.nan])})
    sink.close()
    for i, value in enumerate((0.5, 2.0)):
        folder = tmp_path / "settings" / f"{i},gamma={0.9 + i / 20:.4g}"
        events = EventAccumulator(str(folder)).Reload()
        assert events.Scalars("task/a_metric")[0].value == value


def test_settings_that_are_rounded_alike_do_not_share_a_file(tmp_path):
    swept = [Training(0, i, {"algo.gamma": 0.99 + i * 1e-6}) for i in (0, 1)]
    sink = TensorboardSink(tmp_path, swept)
    sink.write(1, 2048, {"a_metric": np.array([1.0, 2.0])})
    sink.close()
    folders = sorted((tmp_path / "settings").iterdir())
    events = [EventAccumulator(str(folder)).Reload() for folder in folders]
    assert [e.Scalars("task/a_metric")[0].value for e in events] == [1.0, 2.0]


def test_pictures_of_one_name_are_a_sequence(tmp_path):
    for i, shade in enumerate((0, 255), start=1):
        picture = np.full((4, 6, 3), shade, np.uint8)
        write_pictures(tmp_path, {"a_picture": picture}, 2048 * i)
    pictures = EventAccumulator(str(tmp_path)).Reload().Images("a_picture")
    assert [(p.step, p.height, p.width) for p in pictures] == [(2048, 4, 6), (4096, 4, 6)]
    assert pictures[0].encoded_image_string != pictures[1].encoded_image_string


def test_a_moving_picture_stands_beside_a_still_one(tmp_path):
    """TensorBoard gives the browser what it read, by the kind that its first bytes tell."""
    frames = [Image.new("RGB", (6, 4), (shade, 0, 0)) for shade in (0, 255)]
    gif = io.BytesIO()
    frames[0].save(gif, "GIF", save_all=True, append_images=frames[1:])
    still = np.zeros((4, 6, 3), np.uint8)
    write_pictures(tmp_path, {"still": still, "moving": gif.getvalue()}, 2048)
    events = EventAccumulator(str(tmp_path)).Reload()
    assert len(events.Images("still")) == 1
    (moving,) = events.Images("moving")
    assert (moving.step, moving.height, moving.width) == (2048, 4, 6)
    assert img_mime_type_detector.from_bytes(moving.encoded_image_string) == "image/gif"
    assert Image.open(io.BytesIO(moving.encoded_image_string)).n_frames == 2
