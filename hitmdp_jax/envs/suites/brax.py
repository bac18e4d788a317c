"""Brax's own environments under our names: `brax/<name>`."""

from collections.abc import Callable
from typing import Any

import brax.envs
from brax.envs.base import Env

from hitmdp_jax.envs.suites.base import Suite
from hitmdp_jax.errors import unknown_name

BACKENDS = ("generalized", "spring", "positional", "mjx")  # of Brax's physics


class BraxSuite(Suite):
    """The environments of Brax's registry; the keyword `backend` chooses among Brax's physics."""

    def names(self) -> tuple[str, ...]:
        """Return the full names of its tasks."""
        return tuple(self.prefix + name for name in brax.envs._envs)  # which has no public listing

    def constructor(self, name: str) -> Callable[..., Env]:
        """Return the class that Brax registered."""
        return brax.envs._envs[name.removeprefix(self.prefix)]

    def check(self, name: str, version: str = "v5", **keywords: Any) -> Callable[..., Env]:
        """Return a task's constructor, having checked the keywords, the back end among them."""
        task = super().check(name, version, **keywords)
        if keywords.get("backend", BACKENDS[0]) not in BACKENDS:
            raise unknown_name("backend", keywords["backend"], BACKENDS)
        return task


SUITE = BraxSuite(prefix="brax/", own_physics=True, ours=False)
