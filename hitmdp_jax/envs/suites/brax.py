"""Brax's own environments under our names: `brax/<name>`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hitmdp_jax.envs.suites.base import Suite
from hitmdp_jax.errors import unknown_name

if TYPE_CHECKING:
    from brax.envs.base import Env

BACKENDS = ("generalized", "spring", "positional", "mjx")  # of Brax's physics


class BraxSuite(Suite):
    """The environments of Brax's registry; the keyword `backend` chooses among Brax's physics."""

    def check(self, name: str, version: str = "v5", **keywords: Any) -> "Callable[..., Env]":
        """Return a task's constructor, having checked the keywords, the back end among them."""
        task = super().check(name, version, **keywords)
        if keywords.get("backend", BACKENDS[0]) not in BACKENDS:
            raise unknown_name("backend", keywords["backend"], BACKENDS)
        return task


SUITE = BraxSuite(
    prefix="brax/",
    own_physics=True,
    ours=False,
    folder="brax.envs",
    tasks={
        "ant": "ant:Ant",
        "fast": "fast:Fast",
        "halfcheetah": "half_cheetah:Halfcheetah",
        "hopper": "hopper:Hopper",
        "humanoid": "humanoid:Humanoid",
        "humanoidstandup": "humanoidstandup:HumanoidStandup",
        "inverted_pendulum": "inverted_pendulum:InvertedPendulum",
        "inverted_double_pendulum": "inverted_double_pendulum:InvertedDoublePendulum",
        "pusher": "pusher:Pusher",
        "reacher": "reacher:Reacher",
        "swimmer": "swimmer:Swimmer",
        "walker2d": "walker2d:Walker2d",
    },
)
