"""Videos and filmstrips of recorded episodes: the body, and which option moves it."""

import contextlib
import functools
import importlib.util
import math
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from brax.envs.base import Env
from matplotlib import font_manager
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.errors import UsageError, missing_extra
from hitmdp_jax.figures.style import ink, option_color, plain
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.runs.folder import replaced
from hitmdp_jax.video.rendering import SIZE, Painter, forward_velocity

MAX_FPS = 60
HEADER, BORDER, FOOTER = 40, 8, 40  # pixels above a picture, around it and below it
MARGIN = 8  # pixels around the strip of options
FONT_SIZE = 17
THUMBNAIL = (320, 240)  # pixels of a filmstrip's picture
GIF = (320, 10, 10)  # pixels in width, frames a second and seconds of an animated picture
COLUMNS = 8  # pictures in a row of a filmstrip


class Timing(NamedTuple):
    """Which steps of an episode a video shows, and when: real time, at most `MAX_FPS`.

    Frame i shows step `every * i` and stands for `every * dt` seconds.
    """

    every: int  # control steps from one frame to the next
    fps: float


def timing(dt: float) -> Timing:
    """Return the timing of a task whose control step takes `dt` seconds."""
    every = max(1, math.ceil(1 / (MAX_FPS * dt) - 1e-6))
    return Timing(every, 1 / (every * dt))


def require_ffmpeg() -> str:
    """Return the path of ffmpeg, which writes videos.

    Raises:
      UsageError: it is not installed.
    """
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise missing_extra("video", "A video")
    import imageio_ffmpeg

    with contextlib.suppress(RuntimeError):  # none was found
        if named := shutil.which(imageio_ffmpeg.get_ffmpeg_exe()):
            return named
    raise UsageError(
        "There is no ffmpeg to write a video with: install it, or name it by the variable "
        "IMAGEIO_FFMPEG_EXE."
    )


def write_video(
    path: Path,
    env: MujocoEnv,
    recorded: Trajectories,
    episodes: Sequence[int] | None = None,
    size: tuple[int, int] = SIZE,
) -> None:
    """Write recorded episodes, one after the other, as an MP4 that browsers play (H.264).

    Args:
      path: the file, which appears when it is whole.
      env: the task they were recorded in.
      recorded: the episodes, with their physics.
      episodes: which of them; None takes all.
      size: width and height of the picture of the body, pixels; even numbers.

    Raises:
      UsageError: nothing can be drawn here, or no video written.
    """
    every, fps = timing(env.dt)
    chosen = range(len(recorded.terminated)) if episodes is None else episodes
    frame_size = Scene.frame_size(size, recorded.option is not None)
    with encoder(path, frame_size, fps) as write, Painter(env.model, size) as painter:
        for number, episode in enumerate(chosen, start=1):
            title = f"episode {number} of {len(chosen)}" if len(chosen) > 1 else ""
            for frame in Scene(env, recorded, episode, title).frames(painter, every):
                write(frame)


@contextlib.contextmanager
def encoder(
    path: Path, size: tuple[int, int], fps: float
) -> Iterator[Callable[[np.ndarray], object]]:
    """Give a function that adds a frame [height, width, 3] to a video.

    Args:
      path: the file, which appears when it is whole.
      size: width and height, even numbers.
      fps: frames a second.

    Raises:
      UsageError: there is no ffmpeg, or it fails.
      OSError: naming the file: it cannot be written.
    """
    ffmpeg = require_ffmpeg()
    width, height = size
    command = [ffmpeg, "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{fps:.6f}", "-i", "-", "-c:v", "libx264"]
    command += ["-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", "25"]
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


class Scene:
    """One episode's frames: the body in a border of the option's colour, and the figures around it.

    Above it stand the option, the return so far, the speed and the time; below it the options of
    the whole episode, with a cursor. A policy without options has neither border nor strip.

    Args:
      env: the task.
      recorded: the episodes, with their physics.
      episode: which of them.
      title: what else stands above.
    """

    def __init__(self, env: MujocoEnv, recorded: Trajectories, episode: int, title: str = ""):
        length = int(np.asarray(recorded.alive)[:, episode].sum())

        def own(steps: Any) -> np.ndarray:
            return np.asarray(steps)[:length, episode]

        assert recorded.qpos is not None
        self.length = length
        self.qpos, self.qvel = own(recorded.qpos), own(recorded.qvel)
        self.option = None if recorded.option is None else own(recorded.option)
        self._returns = own(recorded.reward).cumsum()
        self._speed = forward_velocity(env.model, self.qvel)
        self._dt, self._title = env.dt, title

    @staticmethod
    def frame_size(size: tuple[int, int], options: bool) -> tuple[int, int]:
        """Return width and height of a frame around a picture of the body."""
        width, height = size
        if not options:
            return width, HEADER + height
        return width + 2 * BORDER, HEADER + height + 2 * BORDER + FOOTER

    def frames(self, painter: Painter, every: int = 1) -> Iterator[np.ndarray]:
        """Yield a frame [height, width, 3] of every so many steps."""
        for step in range(0, self.length, every):
            yield self.frame(painter.paint(self.qpos[step], self.qvel[step]), step)

    def frame(self, body: np.ndarray, step: int) -> np.ndarray:
        """Return the frame of a step around the picture of its body."""
        width, height = self.frame_size((body.shape[1], body.shape[0]), self.option is not None)
        canvas = Image.new("RGB", (width, height), "white")
        draw = ImageDraw.Draw(canvas)
        border = 0
        if self.option is not None:
            border, color = BORDER, option_color(self.option[step])
            draw.rectangle((0, HEADER, width, height - FOOTER - 1), fill=color)
            self._draw_option(draw, int(self.option[step]), color)
            canvas.paste(self._strip(width - 2 * MARGIN), (MARGIN, height - FOOTER + MARGIN))
            x = MARGIN + (step + 0.5) / self.length * (width - 2 * MARGIN)
            draw.rectangle((x - 2, height - FOOTER + 3, x + 2, height - 3), fill="white")
            draw.line((x, height - FOOTER + 3, x, height - 4), fill="black", width=2)
        canvas.paste(Image.fromarray(body), (border, HEADER + border))
        self._write(draw, width, step)
        return np.asarray(canvas)

    def _draw_option(self, draw: ImageDraw.ImageDraw, option: int, color: str) -> None:
        text = f"option {option}"
        left, right = MARGIN, MARGIN + 16 + font().getlength(text)
        draw.rounded_rectangle((left, 6, right, HEADER - 6), radius=6, fill=color)
        draw.text((left + 8, HEADER / 2), text, ink(color), font(), anchor="lm")

    def _write(self, draw: ImageDraw.ImageDraw, width: int, step: int) -> None:
        """Write the numbers, each in a place of its own so that none moves as they grow."""
        facts = [f"{step * self._dt:.2f} s", f"return {self._returns[step]:,.1f}"]
        if self._speed is not None:
            facts.insert(1, f"{self._speed[step].round(1) + 0.0:.1f} m/s")
        if self._title:
            facts.append(self._title)
        right = width - MARGIN
        for text, room in zip(facts, (80, 90, 150, 130), strict=False):
            draw.text((right, HEADER / 2), text, "black", font(), anchor="rm")
            right -= room

    def _strip(self, width: int) -> Image.Image:
        """Return the options of the whole episode, from left to right."""
        assert self.option is not None
        colors = np.array([to_rgb(option_color(k)) for k in range(self.option.max() + 1)])
        steps = Image.fromarray(np.uint8(255 * colors[self.option][None]))
        # A pixel of several steps shows the mean of their colours.
        return steps.resize((width, FOOTER - 2 * MARGIN), Image.Resampling.BOX)


@functools.cache
def font() -> ImageFont.FreeTypeFont:
    """Return the font of the frames, which Matplotlib brings."""
    return ImageFont.truetype(font_manager.findfont("DejaVu Sans"), FONT_SIZE)


def pictures(
    env: Env, recorded: Trajectories, episode: int = 0, number: int = COLUMNS
) -> dict[int, np.ndarray]:
    """Return step -> picture [height, width, 3] of an episode, from each of equal parts of it.

    Args:
      env: the task.
      recorded: the episodes, with their physics.
      episode: which of them.
      number: of pictures, at most.

    Raises:
      UsageError: the task has no MuJoCo model, or nothing can be drawn here.
    """
    if not isinstance(env, MujocoEnv):
        raise UsageError("the task has no MuJoCo model.")
    scene = Scene(env, recorded, episode)
    with Painter(env.model, THUMBNAIL) as painter:
        steps = evenly(np.arange(scene.length), number).tolist()
        return {step: painter.paint(scene.qpos[step], scene.qvel[step]) for step in steps}


def filmstrip(
    env: MujocoEnv,
    recorded: Trajectories,
    episode: int = 0,
    title: str = "",
    columns: int = COLUMNS,
) -> Figure:
    """Draw what the body does under each option: a row of pictures an option.

    A row's pictures are of an episode's steps under the option, in order, spread evenly over them;
    below each stands its time. A policy without options has one row of the whole episode.

    Args:
      env: the task.
      recorded: the episodes, with their physics.
      episode: which of them.
      title: the figure's title.
      columns: pictures in a row.

    Raises:
      UsageError: nothing can be drawn here.
    """
    scene = Scene(env, recorded, episode)
    rows = _rows(scene)
    figure = Figure(figsize=(1.0 + 1.6 * columns, 0.4 + 1.5 * len(rows)), layout="constrained")
    every_axes = figure.subplots(len(rows), columns, squeeze=False)
    with Painter(env.model, THUMBNAIL) as painter:
        for axes_of_row, (label, color, steps) in zip(every_axes, rows, strict=True):
            axes_of_row[0].set_ylabel(label)
            chosen = evenly(steps, columns)
            for axes, step in zip(axes_of_row, chosen, strict=False):
                axes.imshow(painter.paint(scene.qpos[step], scene.qvel[step]))
                axes.set_xlabel(f"{step * env.dt:.2f} s")
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set(color=color, linewidth=3)
            for axes in axes_of_row[len(chosen) :]:
                axes.set_axis_off()
    figure.suptitle(plain(title))
    return figure


def _rows(scene: Scene) -> list[tuple[str, str, np.ndarray]]:
    """Return label, colour and steps of a filmstrip's rows."""
    if scene.option is None:
        return [("whole episode", "black", np.arange(scene.length))]
    started = np.diff(scene.option, prepend=-1) != 0
    rows = []
    for k in np.unique(scene.option):
        steps = np.flatnonzero(scene.option == k)
        share, duration = len(steps) / scene.length, len(steps) / started[steps].sum()
        label = f"option {k}\n{share:.0%} of steps\n{duration:.1f} at a time"
        rows.append((label, option_color(int(k)), steps))
    return rows


def evenly(steps: np.ndarray, number: int) -> np.ndarray:
    """Return at most so many of the steps: the middle one of each of `number` equal parts."""
    places = ((np.arange(number) + 0.5) / number * len(steps)).astype(int)
    return steps[np.unique(places)]
