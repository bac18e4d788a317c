"""Videos of recorded episodes, written by ffmpeg."""

import contextlib
import itertools
import math
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import imageio_ffmpeg
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.runs.folder import replaced
from hitmdp_jax.video.frames import BORDER, Scene
from hitmdp_jax.video.pictures import painter_of
from hitmdp_jax.video.rendering import SIZE

MAX_FPS = 60
WITHOUT_CLOCK = 8.0  # frames per second of tasks whose steps take no time
MAX_CLIP_FPS = 10  # of clips: a page holds several, and drawing their frames takes its time
CLIP = (240, 180)  # pixels of the picture of the body in a clip
SHARP, LIGHT = 25, 30  # how coarse a video is (x264's CRF); of 30 it has half as many bytes
SMALL = (480, 360)  # pixels of the picture of the body in each of several films side by side
GIF = (320, 10, 10)  # pixels in width, frames per second and seconds of an animated picture


class Timing(NamedTuple):
    """Which steps of an episode a video shows, and when, in real time.

    Frame i shows step `every * i` and stands for `every * dt` seconds.
    """

    every: int  # control steps from one frame to the next
    fps: float


def timing(dt: float | None, most: float = MAX_FPS) -> Timing:
    """Return the timing of a video.

    Args:
      dt: seconds that a control step of the task takes; None of a task without a clock.
      most: frames per second, at most.
    """
    if dt is None:
        return Timing(1, WITHOUT_CLOCK)
    every = max(1, math.ceil(1 / (most * dt) - 1e-6))
    return Timing(every, 1 / (every * dt))


def require_ffmpeg() -> str:
    """Return the path of ffmpeg, which writes videos.

    Raises:
      UsageError: there is none for this machine.
    """
    with contextlib.suppress(RuntimeError):  # none was found
        if named := shutil.which(imageio_ffmpeg.get_ffmpeg_exe()):
            return named
    raise UsageError(
        "There is no ffmpeg to write a video with: install it, or name it by the variable "
        "IMAGEIO_FFMPEG_EXE."
    )


def write_video(
    path: Path,
    env: Env,
    recorded: Trajectories,
    episodes: Sequence[int] | None = None,
    size: tuple[int, int] = SIZE,
) -> None:
    """Write recorded episodes, one after the other, as an MP4 that browsers play (H.264).

    Args:
      path: the file, which appears when it is whole.
      env: the task they were recorded in.
      recorded: the episodes, with what pictures need.
      episodes: which of them; None takes all.
      size: width and height of the picture of the body, pixels; even numbers.

    Raises:
      UsageError: nothing can be drawn here, or no video written.
    """
    every, fps = timing(spec_of(env).dt)
    chosen = range(len(recorded.terminated)) if episodes is None else episodes
    frame_size = Scene.frame_size(size, recorded.option is not None)
    with encoder(path, frame_size, fps) as write, painter_of(env, size) as painter:
        for number, episode in enumerate(chosen, start=1):
            title = f"episode {number} of {len(chosen)}" if len(chosen) > 1 else ""
            for frame in Scene(env, recorded, episode, title).frames(painter, every):
                write(frame)


def write_side_by_side(
    path: Path, env: Env, films: Sequence[Trajectories], size: tuple[int, int] = SMALL
) -> None:
    """Write the first episodes of several recordings side by side, as an MP4.

    An episode that has ended stands still on its last frame until the longest has ended, too.

    Args:
      path: the file, which appears when it is whole.
      env: the task they were recorded in.
      films: the recordings, with what pictures need; all of them with options, or none.
      size: width and height of each picture of the body, pixels; even numbers.

    Raises:
      UsageError: nothing can be drawn here, or no video written.
    """
    every, fps = timing(spec_of(env).dt)
    columns = math.ceil(math.sqrt(len(films)))
    rows = math.ceil(len(films) / columns)
    width, height = Scene.frame_size(size, films[0].option is not None)
    with (
        encoder(path, (columns * width, rows * height), fps) as write,
        painter_of(env, size) as painter,
    ):
        scenes = [Scene(env, recorded, 0).frames(painter, every) for recorded in films]
        for frames in together(scenes):
            write(grid(frames, columns))


def write_clips(
    paths: Sequence[Path],
    env: Env,
    films: Sequence[Trajectories],
    size: tuple[int, int] = CLIP,
) -> None:
    """Write the first episode of each of several recordings as a small MP4 of its own.

    A frame is the body in a border of the option's colour. All clips are of one length: an episode
    that has ended stands still, as in `write_side_by_side`.

    Args:
      paths: a file for each recording.
      env: the task they were recorded in.
      films: the recordings, with options and with what pictures need.
      size: width and height of each picture of the body, pixels; even numbers.

    Raises:
      UsageError: nothing can be drawn here, or no video written.
    """
    every, fps = timing(spec_of(env).dt, MAX_CLIP_FPS)
    bordered = size[0] + 2 * BORDER, size[1] + 2 * BORDER
    with contextlib.ExitStack() as stack:
        painter = stack.enter_context(painter_of(env, size))
        encoders = [stack.enter_context(encoder(path, bordered, fps, LIGHT)) for path in paths]
        scenes = [Scene(env, recorded, 0).bodies(painter, every) for recorded in films]
        for frames in together(scenes):
            for write, frame in zip(encoders, frames, strict=True):
                write(frame)


def together(films: Sequence[Iterator[np.ndarray]]) -> Iterator[list[np.ndarray]]:
    """Yield a frame of each film until all have ended; one that has ended keeps its last."""
    last: list[np.ndarray] = []
    for frames in itertools.zip_longest(*films):
        last = [
            old if new is None else new for old, new in zip(last or frames, frames, strict=True)
        ]
        yield last


def grid(frames: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Return frames [height, width, 3] as one picture, row by row; what is left over is white."""
    missing = -len(frames) % columns
    filled = [*frames, *([np.full_like(frames[0], 255)] * missing)]
    rows = [np.concatenate(filled[i : i + columns], 1) for i in range(0, len(filled), columns)]
    return np.concatenate(rows, 0)


@contextlib.contextmanager
def encoder(
    path: Path, size: tuple[int, int], fps: float, crf: int = SHARP
) -> Iterator[Callable[[np.ndarray], object]]:
    """Give a function that adds a frame [height, width, 3] to a video.

    Args:
      path: the file, which appears when it is whole.
      size: width and height, even numbers.
      fps: frames per second.
      crf: how coarse it is, from 0 to 51.

    Raises:
      UsageError: there is no ffmpeg, or it fails.
      OSError: naming the file: it cannot be written.
    """
    ffmpeg = require_ffmpeg()
    width, height = size
    command = [ffmpeg, "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{fps:.6f}", "-i", "-", "-c:v", "libx264"]
    command += ["-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", str(crf)]
    command += ["-movflags", "+faststart", "-f", "mp4"]
    with replaced(path) as file:
        # Not imageio-ffmpeg's own writer: it forks a process that has threads of JAX's.
        process = subprocess.Popen(
            [*command, f"file:{file.name}"], stdin=subprocess.PIPE, stderr=subprocess.PIPE
        )
        assert process.stdin is not None
        write = process.stdin.write
        try:
            yield lambda frame: write(frame.tobytes())
        except BrokenPipeError:
            pass  # ffmpeg says below why it ended
        except BaseException:
            process.kill()
            raise
        _, errors = process.communicate()
        if process.returncode:
            reason = _last_line(errors) or f"'{ffmpeg}' ended with {process.returncode}"
            raise UsageError(f"'{path}' cannot be written: {reason}")


def _last_line(errors: bytes) -> str:
    return "".join(errors.decode(errors="replace").strip().splitlines()[-1:])


def animated(path: Path) -> bytes:
    """Return how a video begins as an animated GIF, small enough for a page of many.

    Args:
      path: the video.

    Raises:
      UsageError: there is no ffmpeg, or it cannot read the video.
    """
    width, fps, seconds = GIF
    # One palette for all frames, and no dithering, which would flicker.
    steps = f"fps={fps},scale={width}:-1:flags=area,split[a][b];[a]palettegen=max_colors=64[c];"
    command = [require_ffmpeg(), "-loglevel", "error", "-t", str(seconds), "-i", f"file:{path}"]
    command += ["-vf", steps + "[b][c]paletteuse=dither=none:diff_mode=rectangle", "-f", "gif", "-"]
    made = subprocess.run(command, capture_output=True)
    if made.returncode:
        raise UsageError(f"'{path}' cannot be read: {_last_line(made.stderr)}")
    return made.stdout
