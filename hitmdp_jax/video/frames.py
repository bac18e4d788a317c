"""The frames of a video: the body, and which option moves it."""

import functools
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from brax.envs.base import Env
from matplotlib import font_manager
from matplotlib.colors import to_rgb
from PIL import Image, ImageDraw, ImageFont, ImageOps

from hitmdp_jax.envs.drawing import model_of
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.figures.style import ink, option_color
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.video.pictures import OwnPictures
from hitmdp_jax.video.rendering import Painter, forward_velocity

HEADER, BORDER, FOOTER = 40, 8, 40  # pixels above a picture, around it and below it
MARGIN = 8  # pixels around the strip of options
FONT_SIZE = 17


class Scene:
    """One episode's frames: the body in a border of the option's colour, and the figures around it.

    Above it stand the option, the return so far, the speed and the time; below it the options of
    the whole episode, with a cursor. A policy without options has neither border nor strip.

    Args:
      env: the task.
      recorded: the episodes, with what pictures need.
      episode: which of them.
      title: what else stands above.
    """

    def __init__(self, env: Env, recorded: Trajectories, episode: int, title: str = ""):
        length = int(np.asarray(recorded.alive)[:, episode].sum())

        def own(steps: Any) -> np.ndarray:
            return np.asarray(steps)[:length, episode]

        self.length = length
        # What a painter takes: whole states of a task that draws itself, else coordinates.
        self._seen = (recorded.qpos, recorded.qvel)
        if recorded.state is not None:
            self._seen = (recorded.state,)
        self._seen = jax.tree.map(lambda x: x[:length, episode], self._seen)
        self.option = None if recorded.option is None else own(recorded.option)
        self._returns = own(recorded.reward).cumsum()
        model, self._speed = model_of(env), None
        if model is not None and recorded.qvel is not None:
            self._speed = forward_velocity(model, own(recorded.qvel))
        self._dt, self._title = spec_of(env).dt, title

    def shown(self, step: int) -> tuple[Any, ...]:
        """Return the arguments of a painter's `paint` for a step."""
        return jax.tree.map(lambda x: x[step], self._seen)

    def moment(self, step: int) -> str:
        """Say when a step is: in seconds, or by its number where the task has no clock."""
        return f"step {step}" if self._dt is None else f"{step * self._dt:.2f} s"

    @staticmethod
    def frame_size(size: tuple[int, int], options: bool) -> tuple[int, int]:
        """Return width and height of a frame around a picture of the body."""
        width, height = size
        if not options:
            return width, HEADER + height
        return width + 2 * BORDER, HEADER + height + 2 * BORDER + FOOTER

    def frames(self, painter: Painter | OwnPictures, every: int = 1) -> Iterator[np.ndarray]:
        """Yield a frame [height, width, 3] of every so many steps."""
        for step in range(0, self.length, every):
            yield self.frame(painter.paint(*self.shown(step)), step)

    def bodies(self, painter: Painter | OwnPictures, every: int = 1) -> Iterator[np.ndarray]:
        """Yield every so many steps the body alone, in a border of its option's colour."""
        assert self.option is not None
        for step in range(0, self.length, every):
            body = Image.fromarray(painter.paint(*self.shown(step)))
            yield np.asarray(ImageOps.expand(body, BORDER, option_color(self.option[step])))

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
        facts = [self.moment(step), f"return {self._returns[step]:,.1f}"]
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
