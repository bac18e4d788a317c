"""`SpecTask`: a task without MuJoCo whose spec says what its sizes are."""

from brax.envs.base import Env

from hitmdp_jax.envs.spec import Spec


class SpecTask(Env):
    """A task that brings its own `spec`; a subclass has `reset` and `step` besides."""

    spec: Spec
    backend = "none"  # pyright: ignore[reportAssignmentType]

    @property
    def observation_size(self) -> int:
        """The number of entries of an observation."""
        return self.spec.observation.size

    @property
    def action_size(self) -> int:
        """The number of choices, or of numbers in an action."""
        return self.spec.action.size
