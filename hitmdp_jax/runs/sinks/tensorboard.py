"""TensorBoard events: the mean over the seeds of a setting, and their deviation."""

import secrets
import struct
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog  # pyright: ignore
from tensorboardX.proto.summary_pb2 import Summary  # pyright: ignore
from tensorboardX.summary import image, scalar

from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import EVENTS, SETTINGS, subfolder
from hitmdp_jax.runs.sinks.base import Sink, Values, curves
from hitmdp_jax.training.sweep import Training, label

FLUSH_INTERVAL = 5.0  # seconds; every flush waits for the disk


def open_sink(config: RunConfig, run_dir: Path, resume_after: int) -> "TensorboardSink":
    """Return the sink of a run, which goes on after an iteration."""
    return TensorboardSink(run_dir, config.trainings, config.schedule.steps_after(resume_after))


class TensorboardSink(Sink):
    """Writes events beside metrics.csv, at environment steps of one seed.

    A curve is a mean over seeds; that of `NAME_std` is their standard deviation.

    The settings of a sweep have a folder each in `settings/`, which TensorBoard shows as runs.

    It writes in the caller's thread: `SummaryWriter`'s own may hold points back when the process is
    killed, and a checkpoint must not be ahead of them.

    Args:
      run_dir: the run's folder.
      trainings: what each row of the metrics belongs to.
      resume_after: environment steps whose points stay; later ones of an earlier process do not.
    """

    name = "TensorBoard"

    def __init__(self, run_dir: Path, trainings: Sequence[Training], resume_after: int = 0):
        self._settings = np.array([training.setting for training in trainings])
        labels = {training.setting: label(training.swept) for training in trainings}
        self._writers = []
        for setting, text in labels.items():
            # The number as well: labels are rounded, and random settings may come close.
            name = f"{setting},{text.replace(', ', ',')}"
            folder = subfolder(run_dir, SETTINGS, name) if text else run_dir
            self._writers.append(_events(folder, str(resume_after)))
        self._last_flush = time.monotonic()
        if resume_after:
            start = SessionLog(status=SessionLog.START)
            for writer in self._writers:
                _write(writer, Event(session_log=start, step=resume_after + 1))

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Add a point to each curve."""
        for name, x in curves(metrics):
            for setting, writer in enumerate(self._writers):
                own = x[self._settings == setting]
                known = own[~np.isnan(own)]
                if known.size:
                    _point(writer, name, known.mean(), env_steps)
                    if len(own) > 1:
                        _point(writer, f"{name}_std", known.std(), env_steps)
        if time.monotonic() - self._last_flush > FLUSH_INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Put on disk what was written."""
        for writer in self._writers:
            writer.flush()
        self._last_flush = time.monotonic()

    def close(self) -> None:
        """Flush and close the files."""
        for writer in self._writers:
            writer.close()


def write_pictures(
    folder: Path, pictures: Mapping[str, np.ndarray | bytes], env_steps: int
) -> None:
    """Write pictures, which TensorBoard shows in a run named by the folder, beside the metrics'.

    TensorBoard reads the newest of a folder's files alone, and that of the metrics still grows.

    Args:
      folder: where the events go; it is there.
      pictures: name -> a picture [height, width, 3 or 4], 8 bits a colour, or an animated one, the
        bytes of a GIF; those of one name are shown as a sequence.
      env_steps: the pictures' place in their sequences.
    """
    writer = _events(folder, f"{env_steps:013}")
    for name, picture in pictures.items():
        summary = (
            _animation(name, picture)
            if isinstance(picture, bytes)
            else image(name, picture, dataformats="HWC")
        )
        _write(writer, Event(summary=summary, step=env_steps))
    writer.close()


def _events(folder: Path, order: str) -> EventsWriter:
    """Return a writer of a new file of events.

    Files are named by the second, and read in their names' order. What is drawn ends the name, so
    that no other process takes it and nobody can have planted a link there.
    """
    return EventsWriter(str(folder / EVENTS), f".{order}.{secrets.token_hex(4)}")


def _animation(name: str, gif: bytes) -> Summary:
    """Return a summary that holds a GIF. tensorboardX's own `video` needs MoviePy to make one."""
    width, height = struct.unpack_from("<HH", gif, 6)  # GIF89a, Section 18: the logical screen
    shown = Summary.Image(height=height, width=width, colorspace=3, encoded_image_string=gif)
    return Summary(value=[Summary.Value(tag=name, image=shown)])


def _point(writer: EventsWriter, name: str, value: np.floating, env_steps: int) -> None:
    _write(writer, Event(summary=scalar(name, float(value)), step=env_steps))


def _write(writer: EventsWriter, event: Event) -> None:
    event.wall_time = time.time()
    writer.write_event(event)
