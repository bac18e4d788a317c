"""What a task says of itself: its observations, its actions, its time limit and its clock."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax.errors import unknown_name

EPISODE_LENGTH = 1000  # control steps: the time limit of tasks that state none


@dataclasses.dataclass(frozen=True)
class Observation:
    """One array, or several by name, which policies read as one row of numbers.

    Attributes:
      shape: as the task gives it; several axes are flattened for the policy. Of several arrays it
        is [O], the row's.
      dtype: as the task gives it; of several arrays, the one that holds them all.
      names: of the O entries of the row; numbers where none are given.
      parts: the name and the shape of each part of the row, in its order; the whole is one part,
        "obs", where none are given. Of one array a part may lie in several places, and is then
        listed as often.
    """

    shape: tuple[int, ...]
    dtype: str = "float32"
    names: tuple[str, ...] = ()
    parts: tuple[tuple[str, tuple[int, ...]], ...] = ()

    def __post_init__(self) -> None:
        if not self.parts:
            object.__setattr__(self, "parts", (("obs", self.shape),))
        if not self.names:
            numbered = (
                f"{part}{list(place) if place else ''}"
                for part, shape in self.parts
                for place in np.ndindex(*shape)
            )
            object.__setattr__(self, "names", tuple(numbered))

    def __str__(self) -> str:
        return f"arrays {list(self.shape)}"

    @property
    def size(self) -> int:
        """O, the number of entries."""
        return math.prod(self.shape)

    def flat(self, obs: Any) -> Any:
        """Return observations, an array [..., *shape] or several by name, as rows [..., O]."""
        if isinstance(obs, Mapping):
            rows = [_row(obs[part], shape) for part, shape in self.parts]
            return jnp.concatenate(rows, axis=-1)
        return _row(obs, self.shape)

    def entries_of(self, parts: Sequence[str]) -> np.ndarray:
        """Return where in the row the named parts are, as indices in the row's order.

        Raises:
          UsageError: there is no part of that name.
        """
        known = [part for part, _ in self.parts]
        if unknown := [part for part in parts if part not in known]:
            raise unknown_name("part of the observation", unknown[0], known)
        owners = np.repeat(known, [math.prod(shape) for _, shape in self.parts])
        return np.flatnonzero(np.isin(owners, list(parts)))


def observation_of(obs: Any) -> Observation:
    """Return the description of an observation, given its shapes as `jax.eval_shape` gives them."""
    if not isinstance(obs, Mapping):
        return Observation(tuple(obs.shape), obs.dtype.name)
    parts = tuple((name, tuple(obs[name].shape)) for name in sorted(obs))
    size = sum(math.prod(shape) for _, shape in parts)
    return Observation((size,), jnp.result_type(*obs.values()).name, parts=parts)


def _row(obs: Any, shape: tuple[int, ...]) -> Any:
    """Return arrays [..., *shape] as rows [..., O]."""
    if len(shape) == 1:
        return obs
    return jnp.reshape(obs, (*np.shape(obs)[: np.ndim(obs) - len(shape)], math.prod(shape)))


@dataclasses.dataclass(frozen=True)
class Box:
    """Actions [A] of real numbers.

    Attributes:
      low: the least value of each of the A entries; -inf where there is none.
      high: the greatest value of each; inf where there is none.
      names: of the entries; numbers where none are given.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _name(self, "action", self.shape)

    def __str__(self) -> str:
        return f"{self.size} numbers"

    @classmethod
    def unlimited(cls, size: int) -> "Box":
        """Return actions [A] of any size."""
        return cls((-math.inf,) * size, (math.inf,) * size)

    @property
    def shape(self) -> tuple[int, ...]:
        """[A]."""
        return (len(self.low),)

    @property
    def dtype(self) -> str:
        """The type of an action."""
        return "float32"

    @property
    def size(self) -> int:
        """A, how many numbers a policy says of a state."""
        return len(self.low)

    @property
    def limits(self) -> np.ndarray | None:
        """The range [2, A]; None where some entry has none."""
        limits = np.array([self.low, self.high], np.float32)
        return limits if np.isfinite(limits).all() else None

    def clip(self, action: Any) -> jax.Array:
        """Return actions [..., A] within the range."""
        low, high = np.array([self.low, self.high], np.float32)
        return jnp.clip(jnp.asarray(action, jnp.float32), low, high)


@dataclasses.dataclass(frozen=True)
class Discrete:
    """Actions [] that are one of n choices, int32 from 0.

    Attributes:
      n: how many choices there are.
      names: of the choices; numbers where none are given.
    """

    n: int
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _name(self, "action", (self.n,))

    def __str__(self) -> str:
        return f"one of {self.n} choices"

    @property
    def shape(self) -> tuple[int, ...]:
        """[]: one number."""
        return ()

    @property
    def dtype(self) -> str:
        """The type of an action."""
        return "int32"

    @property
    def size(self) -> int:
        """The number n of choices, how many numbers a policy says of a state."""
        return self.n

    @property
    def limits(self) -> None:
        """None: choices have no range."""
        return None

    def clip(self, action: Any) -> Any:
        """Return actions [...] as they are."""
        return action


Action = Box | Discrete


@dataclasses.dataclass(frozen=True)
class Spec:
    """What a task says of itself; static, and equal of equal tasks.

    A task of one's own with discrete actions brings one: `spec = Spec(Observation((4,)),
    Discrete(2), episode_length=200)`.

    Attributes:
      observation: the array that `reset` and `step` show.
      action: what `step` takes.
      episode_length: the time limit in control steps.
      dt: seconds of a control step; None where the task has no clock.
    """

    observation: Observation
    action: Action
    episode_length: int = EPISODE_LENGTH
    dt: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON holds it."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, known: dict[str, Any]) -> "Spec":
        """Return the object that `to_dict` was called on."""
        parts = {name: _with_tuples(known[name]) for name in ("observation", "action")}
        kind = Discrete if "n" in parts["action"] else Box
        return cls(
            Observation(**parts["observation"]),
            kind(**parts["action"]),
            known["episode_length"],
            known["dt"],
        )


def spec_of(env: Any) -> Spec:
    """Return a task's description of itself.

    Args:
      env: a task of Brax's interface, unbatched. It may bring a `spec` of its own;
        else it is traced for its observation, and acts in `action_size` numbers of any size.
    """
    # A property that fails is its author's to see.
    own = env.spec if hasattr(type(env), "spec") else getattr(env, "spec", None)
    if isinstance(own, Spec):
        return own
    obs: Any = jax.eval_shape(env.reset, jax.random.key(0)).obs
    dt = getattr(env, "dt", None)
    return Spec(
        observation_of(obs),
        Box.unlimited(int(env.action_size)),
        getattr(env, "episode_length", EPISODE_LENGTH),
        None if dt is None else float(dt),
    )


def _name(part: Any, word: str, shape: tuple[int, ...]) -> None:
    """Number the entries of a part that names none."""
    if not part.names:
        numbered = tuple(f"{word}{list(place)}" for place in np.ndindex(*shape))
        object.__setattr__(part, "names", numbered)


def _with_tuples(known: Any) -> Any:
    """Return a value read from JSON, with tuples in place of its lists."""
    if isinstance(known, list):
        return tuple(map(_with_tuples, known))
    if isinstance(known, dict):
        return {name: _with_tuples(x) for name, x in known.items()}
    return known
