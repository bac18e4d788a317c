"""A trained policy: what acts, and what answers questions about itself."""

import functools
from collections.abc import Iterator, Mapping
from typing import Any

import jax
import numpy as np
from flax import struct
from jax.typing import ArrayLike

from hitmdp_jax.agents.base import Agent
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.normalization import normalize
from hitmdp_jax.precision import in_32_bits

Observed = ArrayLike | Mapping[str, ArrayLike]  # as the task shows it, one array or several by name


class Decision(struct.PyTreeNode):
    """What a policy does in a state. It unpacks into two: `action, memory = policy.act(...)`."""

    action: jax.Array  # [..., A] within the task's range, or the choice [...]
    memory: Any  # what the next step starts from
    option: jax.Array | None  # [...] int, o_t; None of a policy without options

    def __iter__(self) -> Iterator[Any]:
        return iter((self.action, self.memory))

    def __len__(self) -> int:
        return 2

    def __getitem__(self, place: int) -> Any:
        return (self.action, self.memory)[place]


class Policy(struct.PyTreeNode):
    """A trained policy with its observation normaliser: a pytree of pure functions.

    Its methods are compiled where they are called, once for each shape; they may be traced, too.

    >>> policy = load("runs/halfcheetah/mopg/...")  # doctest: +SKIP
    >>> memory = policy.initial_memory(key)  # doctest: +SKIP
    >>> action, memory = policy.act(obs, memory, key)  # doctest: +SKIP
    """

    agent: Agent  # bound to the task that it learned
    params: Any
    normalizer: Any

    @property
    def spec(self) -> Spec:
        """What the policy observes and how it acts."""
        return self.agent.task

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start."""
        return self.agent.initial_memory(key, batch_shape)

    def act(
        self, obs: Observed, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> Decision:
        """Return the policy's decision for raw observations, as the task gives them.

        Actions are within the range that the task says it clips them to.

        Raises:
          UsageError: the observation has another size than those the policy learned from.
        """
        return _act(self, self.flat(obs), memory, key, bool(deterministic))

    def decide(
        self, flat: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> Decision:
        """Do as `act`, not compiled, for observations that are rows [..., O] already."""
        seen = self.seen(flat)
        action, after, noted = self.agent.act(self.params, seen, memory, key, deterministic)
        option = self.agent.option_of(noted)
        return in_32_bits(Decision(self.spec.action.clip(action), after, option))

    def option_probs(self, obs: Observed, memory: Any) -> jax.Array | None:
        """Return P(o_t | s_t, what is remembered) [..., K] for raw observations; Raises as `act`.

        None of a policy without options.
        """
        return _option_probs(self, self.flat(obs), memory)

    def value(self, obs: Observed, memory: Any) -> jax.Array | None:
        """Return the expected discounted return [...] from raw observations; Raises as `act`.

        It is of scaled rewards where `reward_scale` is not 1, and None of an algorithm that does
        not say.
        """
        return _value(self, self.flat(obs), memory)

    def of(self, places: ArrayLike) -> "Policy":
        """Return the policy of one training, or of some, by their places among leaves [R, ...]."""
        return jax.tree.map(lambda x: x[places] if np.ndim(x) else x, self)

    def flat(self, obs: Observed) -> Any:
        """Return raw observations as rows [..., O]; Raises as `act`."""
        shown = self.spec.observation
        if isinstance(obs, Mapping):
            for part, shape in shown.parts:
                if part not in obs:
                    raise UsageError(f"obs lacks its part '{part}'.")
                _check_shape(f"obs['{part}']", obs[part], shape)
        else:
            _check_shape("obs", obs, shown.shape)
        return shown.flat(obs)

    def seen(self, flat: ArrayLike) -> jax.Array:
        """Return rows of raw observations as the agent sees them."""
        return normalize(flat, self.normalizer if self.agent.normalize_observations else None)

    def normalized(self, obs: Observed) -> jax.Array:
        """Return raw observations as the agent sees them, rows [..., O]; Raises as `act`."""
        return self.seen(self.flat(obs))


def _check_shape(name: str, x: ArrayLike, shape: tuple[int, ...]) -> None:
    """Raise UsageError where an array's last axes are not of that shape."""
    if np.shape(x)[np.ndim(x) - len(shape) :] != shape:
        raise UsageError(f"{name} has shape {np.shape(x)}; its last axes must be {shape}.")


# Compiled here: run one operation after the other, a step would take hundreds of times as long.
@functools.partial(jax.jit, static_argnames="deterministic")
def _act(
    policy: Policy, flat: jax.Array, memory: Any, key: jax.Array, deterministic: bool
) -> Decision:
    return policy.decide(flat, memory, key, deterministic)


@jax.jit
def _option_probs(policy: Policy, flat: jax.Array, memory: Any) -> jax.Array | None:
    return policy.agent.option_probs(policy.params, policy.seen(flat), memory)


@jax.jit
def _value(policy: Policy, flat: jax.Array, memory: Any) -> jax.Array | None:
    return policy.agent.value_of(policy.params, policy.seen(flat), memory)
