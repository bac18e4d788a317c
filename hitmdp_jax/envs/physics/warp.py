"""MJX on Warp: the same programs with NVIDIA's own kernels."""

import dataclasses
from collections.abc import Sequence
from typing import ClassVar

import mujoco

from hitmdp_jax.envs.physics.mjx import MjxEngine
from hitmdp_jax.errors import UsageError, missing_extra


@dataclasses.dataclass(frozen=True)
class WarpEngine(MjxEngine):
    """MJX with Warp in place of XLA for the physics."""

    name: ClassVar[str] = "warp"
    implementation: ClassVar[str] = "warp"

    def check(self) -> None:
        """Check that warp-lang is installed.

        Raises:
          UsageError: it is not.
        """
        from mujoco.mjx import warp

        if not warp.WARP_INSTALLED:
            raise missing_extra("warp", "physics=warp")

    def check_task(self, model: mujoco.MjModel, fields: Sequence[str] = ()) -> None:
        """Check that the task reads no external forces, which MJX does not compute on Warp.

        Raises:
          UsageError: it does, or no engine can run the model.
        """
        super().check_task(model, fields)
        if "cfrc_ext" in fields:
            raise UsageError("physics=warp has no contact forces (cfrc_ext): use mjx or native.")
