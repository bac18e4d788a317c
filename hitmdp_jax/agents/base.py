"""What every algorithm is: hyperparameters, checked when it is made, and pure methods."""

import abc
import dataclasses
import math
from typing import Any, Self, dataclass_transform

import jax
from flax import struct

from hitmdp_jax.checks import fault_of_whole, in_float32
from hitmdp_jax.envs.spec import Action, Spec
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics


def traced(
    default: float,
    low: float = 0.0,
    high: float = math.inf,
    infinite: bool = False,
    positive: bool = False,
) -> Any:
    """Declare a float hyperparameter in [low, high], a pytree leaf.

    It is finite unless `infinite`, and above 0 where `positive`: something is divided by it.
    """
    limits = {"low": low, "high": high, "infinite": infinite, "positive": positive}
    return struct.field(default=default, metadata=limits)


def static(default: Any, choices: tuple[str, ...] = (), of: type = int) -> Any:
    """Declare a hyperparameter that shapes the program, and so cannot be traced.

    A tuple holds positive whole numbers, or names where it is one `of` str.
    """
    metadata = {"choices": choices, "of": of}
    return struct.field(pytree_node=False, default=default, metadata=metadata)


def hyperparameters_of(agent: Any) -> tuple[dataclasses.Field, ...]:
    """Return the hyperparameters of an agent or of its class: its fields but for its task."""
    return tuple(field for field in dataclasses.fields(agent) if field.name != "spec")


def check_hyperparameters(agent: Any) -> None:
    """Reject values outside the domains that an agent's fields declare; arrays pass, as traced.

    Raises:
      UsageError: naming the field, its value and what is valid.
    """
    if isinstance(agent, type):
        raise UsageError(f"agent is the class {agent.__name__}: pass an agent, {agent.__name__}().")
    if not isinstance(agent, Agent):
        raise UsageError(f"{agent!r} is not an agent; make one, for example agents.MOPG().")
    for field in hyperparameters_of(agent):
        value, default = getattr(agent, field.name), field.default
        wanted = ""
        if choices := field.metadata.get("choices"):
            if value not in choices:
                raise unknown_name(field.name, str(value), choices)
        elif isinstance(default, bool):
            wanted = "" if isinstance(value, bool) else "true or false"
        elif isinstance(default, float):
            wanted = _fault_of_number(value, **_limits(field))
        elif isinstance(default, int):
            wanted = fault_of_whole((value,), "a positive whole number")
        elif isinstance(default, tuple) and field.metadata.get("of") is str:
            names = isinstance(value, tuple) and all(isinstance(x, str) for x in value)
            wanted = "" if names else "a list of names"
        elif isinstance(default, tuple):
            values = value if isinstance(value, tuple) and value else (None,)
            wanted = fault_of_whole(values, "a list of positive whole numbers")
        if wanted:
            raise out_of_domain(
                field.name, list(value) if isinstance(value, tuple) else value, wanted
            )


def _limits(field: dataclasses.Field) -> dict[str, Any]:
    anything = {"low": -math.inf, "high": math.inf, "infinite": False, "positive": False}
    return {name: field.metadata.get(name, limit) for name, limit in anything.items()}


def _fault_of_number(value: Any, low: float, high: float, infinite: bool, positive: bool) -> str:
    """Return which values a float hyperparameter may have, or nothing if its value is valid."""
    above = " above 0" if positive else f" from {low:g}" if low > -math.inf else ""
    bounded = infinite or high < math.inf
    wanted = f"a number{above} to {high:g}" if bounded else f"a finite number{above}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return "" if hasattr(value, "dtype") else wanted
    if not low <= value <= high or (math.isinf(value) and not infinite):
        return wanted
    if math.isinf(in_float32(value)) and not math.isinf(value):
        return f"{wanted}, at most 3.4e+38"
    return wanted if positive and in_float32(value) == 0 else ""


class LearnerState(struct.PyTreeNode):
    """What an agent's update changes; an algorithm that needs more has a subclass of its own."""

    params: Any
    opt_state: Any


@dataclass_transform(frozen_default=True)
@dataclasses.dataclass(frozen=True)
class Agent(abc.ABC):
    """An algorithm: a frozen dataclass of hyperparameters with pure methods.

    A subclass lists its hyperparameters as fields with defaults and is a dataclass and a pytree
    without further ado: floats are leaves, so they may be traced and vmapped; ints, strings and
    tuples are static. `traced` and `static` also declare a field's domain, which is checked when an
    agent is made. It owes three methods, `init`, `act` and `update`.

    `spec` is no hyperparameter: it is the task that the agent acts in. Training and `load` bind the
    agent to it, so that `act` and `update` know what actions there are.

    `memory` is what the policy carries from step to step: nothing for PPO, o_{t-1} for MOPG. Every
    method takes any leading batch shape.
    """

    # What training does for every algorithm: see `normalization.normalize`, and the factor by which
    # an update sees rewards multiplied; metrics stay as the task pays.
    normalize_observations: bool = static(True)
    reward_scale: float = traced(1.0, positive=True)

    spec: Spec | None = dataclasses.field(default=None, kw_only=True)

    option_rewards = ()  # names of the task's rewards for options that `update` finds in the batch

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        dataclasses.dataclass(frozen=True)(cls)
        _register(cls)

    def __new__(cls, *args: Any, **hyperparameters: Any) -> Self:
        """Check the names, which `__init__` would not explain."""
        fields = [field.name for field in hyperparameters_of(cls)]
        for name in hyperparameters:
            if name not in (*fields, "spec"):
                raise unknown_name(f"hyperparameter of {cls.__name__}", name, fields)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        fields = dataclasses.fields(self)
        values = [getattr(self, field.name) for field in fields]
        for field, value in zip(fields, values, strict=True):
            if isinstance(value, list):
                object.__setattr__(self, field.name, tuple(value))  # static values are hashed
        leaves = [x for field, x in zip(fields, values, strict=True) if _is_leaf(field)]
        # Nothing but None and ints are the axes of `jax.vmap(..., in_axes=agent)`.
        if any(x is not None and type(x) is not int for x in leaves):
            check_hyperparameters(self)

    def replace(self, **changes: Any) -> Self:
        """Return the agent with other hyperparameters."""
        return dataclasses.replace(self, **changes)

    def bind(self, spec: Spec) -> Self:
        """Return the agent of a task."""
        return self.replace(spec=spec)

    @property
    def task(self) -> Spec:
        """What the agent's task lets it observe and do.

        Raises:
          UsageError: the agent is bound to no task.
        """
        if self.spec is None:
            name = type(self).__name__
            raise UsageError(f"This {name} knows no task: bind it, {name}().bind(spec_of(env)).")
        return self.spec

    @property
    def actions(self) -> Action:
        """The actions of the agent's task; Raises as `task`."""
        return self.task.action

    def traced_values(self) -> dict[str, Any]:
        """Return the hyperparameters that are pytree leaves, by name: what may be swept."""
        return {f.name: getattr(self, f.name) for f in hyperparameters_of(self) if _is_leaf(f)}

    def scheduled(self, progress: jax.Array) -> "Agent":
        """Return the agent as it acts and learns after a fraction `progress` of the run."""
        return self

    def check_batch(self, num_samples: int, spelled: str = "num_samples") -> None:  # noqa: B027
        """Reject a number of samples an update that `update` cannot work with.

        Args:
          num_samples: T * B of a rollout.
          spelled: the number in the user's terms, for the sentence.

        Raises:
          UsageError: saying which number would do.
        """

    @abc.abstractmethod
    def init(self, key: jax.Array, spec: Spec) -> LearnerState:
        """Return new parameters and optimiser state for a task."""

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start."""
        return ()

    @abc.abstractmethod
    def act(
        self, params: Any, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any, Any]:
        """Choose actions for normalised observations [..., O].

        Returns:
          The action [..., A], or the choice [...]; the new memory; and a record of what else
          `update` needs.
        """

    def init_replay(self, spec: Spec) -> Any:
        """Return an empty memory of rollouts; an off-policy agent has one (`learning.replay`).

        It is not part of the learner: it may be large, is updated in place, and is saved with a
        run only where that is asked for.
        """
        return ()

    def store(self, replay: Any, batch: Batch) -> Any:
        """Return the replay with a rollout in it, raw; `update` finds it in `batch.replay`."""
        return replay

    @abc.abstractmethod
    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Learn from one rollout, its observations raw (`Batch.normalized`), its rewards scaled.

        The metrics' names are explained in `metrics`. A `loss` among them that is not finite ends
        the training's learning, as parameters do that are not.
        """

    def option_of(self, record: Any) -> jax.Array | None:
        """Return the options [...] that were executed; None where the algorithm has none."""
        return None

    def option_probs(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array | None:
        """Return P(o_t | s_t, o_{t-1}) [..., K] for normalised observations [..., O], or None."""
        return None

    def value_of(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array | None:
        """Return the critic's V [...] for normalised observations [..., O]; None without critic."""
        return None

    def policy(self, params: Any, obs: jax.Array, option: Any) -> Any:
        """Return P(a | s, o), a distribution of Distrax, for normalised observations [..., O].

        The options [...] may be other ones than the agent would take; observations and options
        broadcast. Without options it is P(a | s), whatever is named; None where nobody says.
        """
        return None


def _is_leaf(field: dataclasses.Field) -> bool:
    return field.metadata.get("pytree_node", isinstance(field.default, float))


def _register(cls: type[Agent]) -> None:
    """Make a pytree of an agent's class.

    JAX puts tracers, axes, shapes and sentinels into the leaves, so taking an agent apart and
    together again must not go through the constructor and its checks.
    """
    fields = dataclasses.fields(cls)
    leaves = [field.name for field in fields if _is_leaf(field)]
    rest = [field.name for field in fields if not _is_leaf(field)]

    def flatten(agent: Agent) -> tuple[list[Any], tuple[Any, ...]]:
        pairs = [(jax.tree_util.GetAttrKey(name), getattr(agent, name)) for name in leaves]
        return pairs, tuple(getattr(agent, name) for name in rest)

    def unflatten(values: tuple[Any, ...], children: Any) -> Agent:
        agent = object.__new__(cls)
        vars(agent).update(zip(leaves + rest, (*children, *values), strict=True))
        return agent

    jax.tree_util.register_pytree_with_keys(cls, flatten, unflatten)
