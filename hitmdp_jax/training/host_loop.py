"""A training whose iterations the host begins one by one, so that callbacks may look and end it."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from hitmdp_jax.agents.base import Agent
from hitmdp_jax.errors import UsageError
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.training.callbacks import Callback, Moment, told
from hitmdp_jax.training.policy import Policy
from hitmdp_jax.training.state import TrainState

Iterate = Callable[[TrainState], tuple[TrainState, Metrics]]


def compiled(step: Iterate, state: TrainState) -> Iterate:
    """Compile an iteration for states like the given one.

    It is given the replay's memory to write into; the rest of the state, which is small, may still
    be read by others.
    """

    def donated(replay: Any, rest: TrainState) -> tuple[TrainState, Metrics]:
        return step(rest.replace(replay=replay))

    def parts(state: TrainState) -> tuple[Any, TrainState]:
        return state.replay, state.replace(replay=())

    program = jax.jit(donated, donate_argnums=0).lower(*parts(state)).compile()
    layouts = [x.sharding for x in jax.tree.leaves(state)]

    def iterate(state: TrainState) -> tuple[TrainState, Metrics]:
        # XLA says of an array without entries that every device has all of it, and then refuses it.
        leaves, structure = jax.tree.flatten(state)
        pairs = zip(leaves, layouts, strict=True)
        same = [x if x.size else jax.device_put(x, layout) for x, layout in pairs]
        return program(*parts(jax.tree.unflatten(structure, same)))

    return iterate


def check_untraced(agent: Agent, env: Any, key: jax.Array) -> None:
    """Check that a training is not being traced, by what it is a function of.

    Raises:
      UsageError: it is, and so nobody can look at its numbers.
    """
    if any(isinstance(x, Tracer) for x in jax.tree.leaves((agent, vars(env), key))):
        raise UsageError(
            "callbacks and stop_at_return work between compiled iterations, so train cannot be "
            "traced with them: call it outside of jax.jit and jax.vmap; key may be several, [R]."
        )


def train_with(
    callbacks: Sequence[Callback],
    agent: Agent,
    init: Callable[[jax.Array], TrainState],
    step: Iterate,
    key: jax.Array,
    *,
    iterations: int,
    env_steps: int,
) -> tuple[TrainState, Metrics]:
    """Train, and call callbacks after the iterations that they ask for.

    Args:
      callbacks: what is called.
      agent: the algorithm that is trained.
      init: makes the state of one training of its key.
      step: one iteration.
      key: of one training, or [R] of several that go on side by side.
      iterations: the most there are, where no callback ends it.
      env_steps: environment steps of each training in an iteration.

    Returns:
      The state and the metrics, as `train` does; of several trainings all of it is [R, ...].

    Raises:
      UsageError: as `told`.
    """
    keys = key if key.ndim else key[None]
    state = jax.jit(jax.vmap(init))(keys)
    step = compiled(jax.vmap(step), state)
    rows: list[dict[str, Any]] = []
    with ExitStack() as stack:
        for callback in callbacks:
            stack.callback(callback.close)
        for iteration in range(1, iterations + 1):
            state, metrics = step(state)
            due = [c for c in callbacks if iteration % max(1, c.every // env_steps) == 0]
            silent = {x: np.full(len(keys), np.nan) for c in callbacks for x in c.names}
            rows.append(metrics | silent)
            if not due:
                continue
            policy = Policy(agent.bind(state.spec), state.learner.params, state.normalizer)
            known = jax.device_get(metrics)
            now = Moment(iteration * env_steps, iteration, known, policy)
            for callback in due:
                rows[-1] |= told(callback, now)
            if now.stopped:
                break
    history = jax.tree.map(lambda *x: jnp.stack(x, axis=1), *rows)
    return (state, history) if key.ndim else jax.tree.map(lambda x: x[0], (state, history))
