"""Pictures of a task's states, whoever draws them."""

from typing import Any

import numpy as np
from PIL import Image

from hitmdp_jax.envs.drawing import draws_itself, model_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.video.rendering import SIZE, Painter


class OwnPictures:
    """Fits the pictures that a task draws itself into one size.

    Args:
      env: the task; it has `draw`.
      size: width and height of a picture, pixels.
    """

    def __init__(self, env: Any, size: tuple[int, int]):
        self._draw, self._size = env.draw, size

    def paint(self, state: Any) -> np.ndarray:
        """Return the picture [height, width, 3] of a state, 8 bits a colour."""
        return fitted(np.asarray(self._draw(state), np.uint8), self._size)

    def __enter__(self) -> "OwnPictures":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is held."""


def painter_of(env: Any, size: tuple[int, int] = SIZE) -> Painter | OwnPictures:
    """Return a painter of a task's states; its `paint` takes what `Scene.shown` gives.

    Raises:
      UsageError: the task cannot be drawn, or nothing can on this machine.
    """
    if draws_itself(env):
        return OwnPictures(env, size)
    if (model := model_of(env)) is None:
        raise UsageError("the task has no MuJoCo model and no method draw.")
    return Painter(model, size)


def fitted(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return a picture [H, W, 3] in the middle of a white one of that width and height.

    Small pictures grow by whole numbers, so that a square of a grid stays sharp.
    """
    (width, height), (rows, columns, _) = size, picture.shape
    share = min(width / columns, height / rows)
    grows = share >= 1.0
    share = int(share) if grows else share
    inner = max(1, round(columns * share)), max(1, round(rows * share))
    way = Image.Resampling.NEAREST if grows else Image.Resampling.BOX
    canvas = Image.new("RGB", size, "white")
    left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
    canvas.paste(Image.fromarray(picture).resize(inner, way), (left, top))
    return np.asarray(canvas)
