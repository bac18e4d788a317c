"""How much memory a run needs at the least."""

import itertools
import math
from typing import Any

import jax
from brax.envs.base import Env

from hitmdp_jax import plugins
from hitmdp_jax.agents import Agent
from hitmdp_jax.checks import check_memory
from hitmdp_jax.envs.spec import Box, Observation, Spec, spec_of
from hitmdp_jax.networks.reads import Reads
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.training.sizes import SHORTEST, shortest_episode, usual_pool_size

REWARD = 4  # bytes of one, the least that a task's state holds


def check_run_memory(
    config: RunConfig, env: Env | None = None, at_once: int = 1, available: int | None = None
) -> None:
    """Check that what a run must hold at once can fit into memory, before any of it is made.

    The estimate is a lower bound. It counts the parameters, the optimiser, the replay and the
    states of the environments and of the pool of each training, and the observations, actions
    and rewards of the rollouts.

    `Run.create` checks once it knows the tasks and the devices. A run of 1e9 trainings never
    gets so far, and no job of a sweep may wait for it: they are checked before, with a task as
    small as can be and memory that may be an accelerator's. So is what trains on accelerators
    that do not say how much they have; what is too much for them ends when it is made, in a
    sentence, too (`cli.guard`).

    Args:
      config: the run's settings.
      env: the task; None while it is not known.
      at_once: trainings whose rollouts are held at once.
      available: as `checks.check_memory`.

    Raises:
      UsageError: it cannot fit; names the settings that need most.
    """
    settings = config.samples or math.prod(len(x) for x in (config.sweep or {}).values())
    trainings, agent = config.seeds * settings, config.make_agent()
    steps = config.num_envs * config.rollout_length
    learner, replay, state, spec, shortest = 0, 0, REWARD, _least_task(agent), SHORTEST
    if env is not None:
        spec, shortest = spec_of(env), shortest_episode(env)
        state = _bytes_of(jax.eval_shape(env.reset, jax.random.key(0)))
    states = config.num_envs + usual_pool_size(config.num_envs, config.rollout_length, shortest)
    # An algorithm of one's own may not learn of any sizes.
    if env is not None or not plugins.is_own(config.algo["name"]):
        learner = _bytes_of(jax.eval_shape(lambda: agent.init(jax.random.key(0), spec)))
        replay = _bytes_of(jax.eval_shape(lambda: agent.init_replay(spec)))
    check_memory(
        {
            "seeds and the sizes of algo's networks": trainings * learner,
            "seeds and algo's replay": trainings * replay,
            "seeds, num_envs and rollout_length": trainings * states * state
            + at_once * steps * REWARD * (spec.observation.size + math.prod(spec.action.shape) + 1),
            "eval_episodes": 24 * config.eval_episodes if config.eval_every else 0,
        },
        available,
    )


def _least_task(agent: Agent) -> Spec:
    """Return the least that an agent's task may be: a number for each part that it names."""
    reads = (getattr(agent, f"{network}_reads", ()) for network in Reads._fields)
    parts = tuple((part, (1,)) for part in sorted({*itertools.chain(*reads)}))
    return Spec(Observation((max(1, len(parts)),), parts=parts), Box.unlimited(1))


def _bytes_of(arrays: Any) -> int:
    return sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(arrays))
