"""Physics engines behind one protocol: MJX (XLA), MuJoCo C, and MJX on Warp."""

import hitmdp_jax.quiet_mjx  # noqa: F401
from hitmdp_jax.errors import unknown_name
from hitmdp_jax.physics.base import Engine, Physics, PhysicsState, SolverBudget
from hitmdp_jax.physics.mjx import MjxEngine
from hitmdp_jax.physics.native import NativeEngine
from hitmdp_jax.physics.warp import WarpEngine

ENGINES: dict[str, Engine] = {
    engine.name: engine for engine in (MjxEngine(), NativeEngine(), WarpEngine())
}

DEFAULT_ENGINE = "mjx"  # which runs on any device

__all__ = [
    "DEFAULT_ENGINE",
    "ENGINES",
    "Engine",
    "MjxEngine",
    "NativeEngine",
    "Physics",
    "PhysicsChoice",
    "PhysicsState",
    "SolverBudget",
    "WarpEngine",
    "find_engine",
]

PhysicsChoice = str | Engine


def find_engine(choice: PhysicsChoice) -> Engine:
    """Return the engine of that name, or the engine itself.

    Raises:
      UsageError: there is no engine of that name.
    """
    if isinstance(choice, Engine):
        return choice
    if not isinstance(choice, str) or choice not in ENGINES:
        raise unknown_name("physics", str(choice), ENGINES)
    return ENGINES[choice]
