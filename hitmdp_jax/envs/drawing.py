"""How a task is drawn: by its MuJoCo model, or by itself."""

from typing import Any

import mujoco


def model_of(env: Any) -> mujoco.MjModel | None:
    """Return the MuJoCo model that a task steps, None of a task without one."""
    model = getattr(env, "model", None)
    return model if isinstance(model, mujoco.MjModel) else None


def draws_itself(env: Any) -> bool:
    """Return whether a task makes pictures of its own.

    Its method `draw(state)` returns a picture [H, W, 3], uint8, of one state. It is called on the
    host, with NumPy arrays, and need not be pure.
    """
    return hasattr(env, "draw")


def can_be_drawn(env: Any) -> bool:
    """Return whether there can be pictures of a task."""
    return draws_itself(env) or model_of(env) is not None
