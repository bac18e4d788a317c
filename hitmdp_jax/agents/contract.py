"""What training asks of an algorithm, checked before anything is compiled."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import Agent, LearnerState
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import VOCABULARY
from hitmdp_jax.tracing import difference, is_array, shown, traced

OURS = {  # metrics that training itself adds
    name for name, metric in VOCABULARY.items() if metric.over_iterations == "by episodes"
} | {"episodes", "step_reward", "recent_return", "recent_length", "diverged", "steps_per_second"}


def check_algorithm(agent: Agent, num_envs: int, rollout_length: int) -> None:
    """Check what an algorithm's methods return, by tracing them; ours are left alone.

    What the algorithm's own code raises is its author's to see.

    Args:
      agent: the algorithm, bound to its task.
      num_envs: B.
      rollout_length: T.

    Raises:
      UsageError: an array or a structure is not what it should be.
    """
    if type(agent).__module__.split(".")[0] == "hitmdp_jax":
        return
    if fault := _fault(agent, num_envs, rollout_length):
        raise UsageError(f"{type(agent).__name__} cannot learn: {fault}.")


def _fault(agent: Agent, num_envs: int, length: int) -> str | None:
    key, spec = jax.random.key(0), agent.task
    state = traced(lambda key: agent.init(key, spec), key)
    if not isinstance(state, LearnerState):
        return f"its init returns a {type(state).__name__} and must return a LearnerState"
    memory = traced(lambda key: agent.initial_memory(key, (num_envs,)), key)
    for x in jax.tree.leaves(memory):
        if not is_array(x) or x.shape[:1] != (num_envs,):
            return f"its initial_memory holds {shown(x)} and must be [B, ...] of {num_envs} tasks"
    obs = jax.ShapeDtypeStruct((num_envs, spec.observation.size), jnp.float32)
    acted = traced(agent.act, state.params, obs, memory, key)
    if not isinstance(acted, tuple) or len(acted) != 3:
        return "its act must return three things: the action, the memory and the record"
    action, new_memory, record = acted
    shape = num_envs, *spec.action.shape
    if not is_array(action) or action.shape != shape:
        wanted = "[B, A]" if spec.action.shape else "choices [B]"
        return f"its act returns {shown(action)} for actions and must return {wanted}, {[*shape]}"
    if fault := difference(memory, new_memory, "its initial_memory", "its act"):
        return fault
    paid = len(agent.option_rewards)
    batch = _batch(obs, action, memory, record, length, paid)
    replay = traced(lambda: agent.init_replay(spec))
    stored = traced(agent.store, replay, batch)
    if fault := difference(replay, stored, "its init_replay", "its store"):
        return fault
    batch = batch.replace(replay=stored)
    updated = traced(agent.update, state, batch, key)
    if not isinstance(updated, tuple) or len(updated) != 2 or not isinstance(updated[1], Mapping):
        return "its update must return two things: the LearnerState and a dictionary of metrics"
    new_state, metrics = updated
    for name, x in metrics.items():
        if name in OURS:
            return f"its metric '{name}' would hide the training's of that name: call it otherwise"
        if not is_array(x) or len(x.shape) > 1:
            return f"its metric '{name}' is {shown(x)} and must be one number, or one an option"
    return difference(state, new_state, "its init", "its update")


def _batch(obs: Any, action: Any, memory: Any, record: Any, length: int, paid: int) -> Batch:
    def long(tree: Any) -> Any:
        return jax.tree.map(lambda x: jax.ShapeDtypeStruct((length, *x.shape), x.dtype), tree)

    number, flag = (jax.ShapeDtypeStruct(obs.shape[:1], kind) for kind in (jnp.float32, bool))
    return Batch(
        obs=long(obs),
        next_obs=long(obs),
        action=long(action),
        memory=long(memory),
        record=long(record),
        reward=long(number),
        terminated=long(flag),
        truncated=long(flag),
        started=long(flag),
        option_reward=long(jax.ShapeDtypeStruct((obs.shape[0], paid), jnp.float32))
        if paid
        else None,
    )
