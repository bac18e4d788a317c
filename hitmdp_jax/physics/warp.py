"""MJX on Warp: the same programs with NVIDIA's own kernels."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NoReturn

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax.custom_batching import custom_vmap
from mujoco import mjx

from hitmdp_jax.errors import UsageError, missing_extra
from hitmdp_jax.physics.base import Engine, Physics, PhysicsState, SolverBudget
from hitmdp_jax.physics.mjx import MjxPhysics, newton_for_pgs


class WarpPhysics(MjxPhysics):
    """Implements `Physics` with MJX on Warp.

    Warp keeps the contacts of all worlds in one list, and drops what does not fit. So every `vmap`
    around a step ends up in one call, which knows how many worlds there are and has room for
    every contact they could have.
    """

    name = "warp"
    implementation: ClassVar[str] = "warp"

    @functools.cached_property
    def _room(self) -> tuple[int, int]:
        """Contacts and constraints of a world, if all pairs of geoms touched that may."""
        of_one_world = mjx.make_data(self.model, impl="jax")._impl
        return of_one_world.ncon, of_one_world.nefc  # pyright: ignore

    def complete(self, drawn: Mapping[str, jax.Array]) -> NoReturn:
        """Raise UsageError: Warp has one model for all worlds."""
        raise UsageError(
            "physics=warp has one model for all environments: a task that draws its own in each "
            "episode needs mjx or native."
        )

    def step(self, state: PhysicsState, ctrl: jax.Array) -> PhysicsState:
        """Advance `frame_skip` substeps under the constant control `ctrl` [nu]."""
        return in_one_call(self._all(self._advance_from))(state.replace(ctrl=ctrl))

    def _forward(self, state: PhysicsState) -> PhysicsState:
        return in_one_call(self._all(self._forward_from))(state)

    def _substep(self, model: mjx.Model, data: mjx.Data) -> mjx.Data:
        forces = "cfrc_ext" in self._fields
        return mjx.step(_with_options(model, run_rne_postconstraint=forces), data)

    def _all(
        self, function: Callable[[mjx.Data, PhysicsState], PhysicsState]
    ) -> Callable[[PhysicsState], PhysicsState]:
        def worlds(states: PhysicsState) -> PhysicsState:
            blank = self._room_for(len(states.qpos))
            return jax.vmap(functools.partial(function, blank))(states)

        return worlds

    def _room_for(self, worlds: int) -> mjx.Data:
        contacts, constraints = self._room
        with jax.ensure_compile_time_eval():
            data = mjx.make_data(
                self.model,
                impl=self.implementation,
                naconmax=max(1, worlds * contacts),
                njmax=max(1, constraints),
            )
            empty = jax.tree.map(lambda x: not np.any(x), data)
        # A list for many worlds is no constant to store in a program: what is zero is made there.
        return jax.tree.map(lambda x, none: jnp.zeros(x.shape, x.dtype) if none else x, data, empty)


@dataclasses.dataclass(frozen=True)
class WarpEngine(Engine):
    """MJX with Warp in place of XLA for the physics."""

    name: ClassVar[str] = "warp"
    physics: ClassVar[type[Physics]] = WarpPhysics

    def check(self) -> None:
        """Check that warp-lang is installed.

        Raises:
          UsageError: it is not.
        """
        from mujoco.mjx import warp

        if not warp.WARP_INSTALLED:
            raise missing_extra("warp", "physics=warp")

    def prepare(self, model: mujoco.MjModel, budget: SolverBudget | None = None) -> None:
        """Choose Newton for PGS. No budget: Warp's solver stops where it has converged."""
        newton_for_pgs(model)
        # A model may decline MuJoCo C's tree of geoms; Warp has none, and refuses to be told so.
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)

    def build(self, *arguments: Any, **keywords: Any) -> Physics:
        """Build the physics of one prepared model; the arguments are those of `Physics`."""
        import warp

        warp.config.log_level = warp.LOG_WARNING  # it tells of each of some fifty kernels it loads
        return super().build(*arguments, **keywords)


def _with_options(model: mjx.Model, **options: Any) -> mjx.Model:
    own = model.opt._impl.replace(**options)  # pyright: ignore
    return model.replace(opt=model.opt.replace(_impl=own))


def in_one_call(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return what computes one row, so that with every `vmap` around it `function` gets all rows.

    Args:
      function: maps a pytree of arrays [N, ...] to another, row by row, for any N.
    """

    @custom_vmap
    def rows(x: Any) -> Any:
        return function(x)

    @rows.def_vmap
    def flattened(axis_size: int, in_batched: list[Any], x: Any) -> tuple[Any, Any]:
        def joined(has_axis: bool, x: jax.Array) -> jax.Array:
            x = x if has_axis else jnp.broadcast_to(x, (axis_size, *x.shape))
            return x.reshape(-1, *x.shape[2:])

        out = rows(jax.tree.map(joined, in_batched[0], x))
        out = jax.tree.map(lambda x: x.reshape(axis_size, -1, *x.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    def row(x: Any) -> Any:
        return jax.tree.map(lambda x: x[0], rows(jax.tree.map(lambda x: x[None], x)))

    return row
