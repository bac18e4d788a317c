"""What training asks of a task, checked before anything is compiled."""

import copy
import inspect
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.checks import is_positive_whole
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.envs.spec import Observation, Spec, spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.metrics import REWARD_TERM, describe
from hitmdp_jax.tracing import difference, is_array, shown, traced

CHECKED = ("hitmdp_jax", "brax")  # packages whose tasks are tested already
PARTS = ("obs", "reward", "done", "metrics", "info")  # of a state
OURS = ("success", "unstable")  # metrics of the vocabulary that are a task's to report
FORM = "reset(key) -> State and step(state, action) -> State, as brax.envs.Env has them"
OTHERS = {  # an attribute of tasks of another interface -> whose
    "default_params": "gymnax",
    "action_space": "Gymnasium",
    "action_spec": "dm_env",
}


def check_task(env: Any, name: str) -> None:
    """Check that a task can be trained on, by tracing its reset and step; ours are left alone.

    What the task's own code raises is its author's to see. Of a task with a MuJoCo model everything
    is traced but the physics, which takes seconds and is ours.

    Args:
      env: the task.
      name: what it is called in the sentence.

    Raises:
      UsageError: it is no task, of another interface, or its arrays are not what they should be.
    """
    if isinstance(env, type) or not (hasattr(env, "reset") and hasattr(env, "step")):
        raise UsageError(f"{name} is no environment: make one, such as make_env('hopper').")
    if type(getattr(env, "unwrapped", env)).__module__.split(".")[0] in CHECKED:
        return
    fault = _fault_of_sizes(env) or _fault_of_arrays(env)
    if fault:
        raise UsageError(f"{name} cannot be trained on: {fault}.")


def _fault_of_sizes(env: Any) -> str | None:
    """Return what is wrong with the task's own description, or None."""
    own = getattr(env, "spec", None)
    for attribute, whose in OTHERS.items():
        if hasattr(env, attribute) and own is None and not hasattr(env, "action_size"):
            return f"its interface is that of {whose}, and training needs {FORM}"
    if own is not None:
        if not isinstance(own, Spec):
            return f"its spec is a {type(own).__name__} and must be a hitmdp_jax.Spec"
    elif not hasattr(env, "action_size"):
        return "it has no action_size, a positive whole number, and no spec"
    elif not is_positive_whole(env.action_size):
        return f"its action_size = {env.action_size} must be a positive whole number"
    length = getattr(env, "episode_length", 1)
    if not is_positive_whole(length):
        return f"its episode_length = {length} must be a positive whole number"
    for method, arguments in (("reset", ["key"]), ("step", ["state", "action"])):
        try:
            inspect.signature(getattr(env, method)).bind(*arguments)
        except TypeError:
            return f"its {method} must take {' and '.join(arguments)} alone: {FORM}"
        except ValueError:  # nobody knows what it takes
            continue
    return None


def _fault_of_arrays(env: Any) -> str | None:
    """Return what is wrong with the results of reset and step, or None."""
    state = traced(_reset_of(env), jax.random.key(0))
    if missing := [part for part in PARTS if not hasattr(state, part)]:
        return (
            f"its reset returns {shown(state)} without {', '.join(missing)}, and training needs "
            f"{FORM}"
        )
    if jax.tree_util.all_leaves([state]):
        return f"JAX knows no parts of its {type(state).__name__}: let it be a brax.envs.State"
    fault = _fault_of_observation(env, state.obs) or _fault_of_metrics(state.metrics)
    if fault:
        return fault
    if not isinstance(state.info, Mapping):
        return f"its info is a {type(state.info).__name__} and must be a dictionary"
    ends = {"info['truncation']": state.info["truncation"]} if "truncation" in state.info else {}
    for part, x in {"reward": state.reward, "done": state.done, **ends}.items():
        if not is_array(x) or x.shape != () or not _is_real(x):
            return f"its {part} is {shown(x)} and must be one number, float32[]"
    action = spec_of(env).action
    action = jax.ShapeDtypeStruct(action.shape, jnp.dtype(action.dtype))
    after = traced(_step_of(env), state, action)
    if type(after) is not type(state):
        return f"its step returns {shown(after)} and its reset {shown(state)}"
    return difference(state, after, "reset", "step")


def _reset_of(env: Any) -> Any:
    return lambda key: env.reset(key)


def _step_of(env: Any) -> Any:
    """Return a task's step; of a task with a model, without its physics."""
    if not isinstance(env, MujocoEnv):
        return lambda state, action: env.step(state, action)
    still = copy.copy(env)
    still.physics = _Still(env.physics)  # pyright: ignore[reportAttributeAccessIssue]
    return lambda state, action: still.step(state, action)


class _Still:
    """Physics in which nothing moves."""

    def __init__(self, physics: Any):
        self._physics = physics

    def __getattr__(self, name: str) -> Any:
        return getattr(self._physics, name)

    def step(self, state: Any, action: jax.Array) -> Any:
        """Return the state as it was."""
        return state


def _fault_of_observation(env: Any, obs: Any) -> str | None:
    own = getattr(env, "spec", None)
    if isinstance(obs, Mapping):
        return _fault_of_parts(obs, None if own is None else own.observation)
    if not is_array(obs):
        return f"its observation is {shown(obs)} and must be one array, or a dictionary of arrays"
    if obs.ndim == 0 or not obs.size:
        return f"its observation is {shown(obs)} and must be a row of numbers, or an array of them"
    if not _is_real(obs):
        return f"its observation is {shown(obs)} and must be of real numbers"
    if own is not None and obs.shape != own.observation.shape:
        return f"its spec says {list(own.observation.shape)} and it observes {shown(obs)}"
    return None


def _fault_of_parts(obs: Mapping[Any, Any], own: Observation | None) -> str | None:
    """Return what is wrong with an observation that is a dictionary of arrays, or None."""
    for name, x in obs.items():
        if not isinstance(name, str):
            return f"its observation's part {name!r} must be called by a string"
        if not is_array(x) or not x.size or not _is_real(x):
            return f"its observation's part '{name}' is {shown(x)} and must be of real numbers"
    if not obs:
        return "its observation is a dictionary without arrays"
    said, shows = own and sorted(own.parts), sorted((name, x.shape) for name, x in obs.items())
    if said is not None and said != shows:
        return f"its spec says {_listed(said)} and it observes {_listed(shows)}"
    return None


def _listed(parts: Sequence[tuple[str, tuple[int, ...]]]) -> str:
    return ", ".join(f"{name} {list(shape)}" for name, shape in parts)


def _fault_of_metrics(metrics: Any) -> str | None:
    if not isinstance(metrics, Mapping):
        return f"its metrics are a {type(metrics).__name__} and must be a dictionary"
    for name, x in metrics.items():
        if not isinstance(name, str):
            return f"its metric {name!r} must be called by a string"
        if describe(name) is not REWARD_TERM and name not in OURS:
            return f"its metric '{name}' would hide the training's of that name: call it otherwise"
        if not is_array(x) or x.shape != () or not _is_real(x):
            return f"its metric '{name}' is {shown(x)} and must be one number"
    return None


def _is_real(x: jax.ShapeDtypeStruct) -> bool:
    kinds = (jnp.floating, jnp.integer, jnp.bool_)
    return any(jnp.issubdtype(x.dtype, kind) for kind in kinds)
