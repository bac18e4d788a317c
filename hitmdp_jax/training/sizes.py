"""How long a training is, and how large what it draws: sizes that shape the program."""

from typing import Any

from brax.envs.base import Env

from hitmdp_jax.agents.base import Agent
from hitmdp_jax.checks import check_size
from hitmdp_jax.envs.action_repeat import action_repeat_of
from hitmdp_jax.envs.spec import spec_of

POOL_ACTIONS = 32  # in each environment, at least, between two drawings of fresh initial states
SHORTEST = 4  # actions of the shortest episode, of a task that does not say


def num_iterations(
    num_steps: int, num_envs: int, rollout_length: int, action_repeat: int = 1
) -> int:
    """Return how many iterations cover `num_steps` environment steps, the last one whole.

    Environment steps are control steps: `action_repeat` to an action.
    """
    return -(-num_steps // (num_envs * rollout_length * action_repeat))


def shortest_episode(env: Env, episode_length: int | None = None) -> int:
    """Return how many actions an episode of a task lasts at least, or nearly always.

    A task says so by its attribute `shortest_episode`, in control steps. Where a reset takes as
    long as many steps, as the making of a world does, much depends on it: so many fewer initial
    states are drawn that most are not used.

    Args:
      env: the task, unbatched; it may be wrapped.
      episode_length: a time limit in control steps in place of the task's own.
    """
    said = getattr(env, "shortest_episode", None)
    if said is None:
        return SHORTEST
    limit = episode_length or spec_of(env).episode_length
    return max(1, min(said, limit) // action_repeat_of(env))


def pool_period(rollout_length: int, shortest: int = SHORTEST) -> int:
    """Return after how many iterations fresh initial states are drawn again.

    An agent that updates at every step would spend its time on drawing them. Where episodes are
    longer than a rollout, none of the environments ends twice in between.

    Args:
      rollout_length: actions in each environment an iteration.
      shortest: actions of the shortest episode (`shortest_episode`).
    """
    return max(-(-POOL_ACTIONS // rollout_length), shortest // rollout_length)


def usual_pool_size(num_envs: int, rollout_length: int, shortest: int = SHORTEST) -> int:
    """Return how many fresh initial states are drawn at once: as many as episodes may end.

    Args:
      num_envs: environments.
      rollout_length: actions in each of them an iteration.
      shortest: actions of the shortest episode (`shortest_episode`).
    """
    actions = rollout_length * pool_period(rollout_length, shortest)
    return max(1, min(num_envs * actions // SHORTEST, num_envs * -(-actions // shortest)))


def check_sizes(agent: Agent, num_steps: Any, num_envs: Any, rollout_length: Any) -> None:
    """Reject sizes that no program can be built from.

    Raises:
      UsageError: a size is not a positive whole number, or a rollout does not divide into
        minibatches.
    """
    sizes = {"num_steps": num_steps, "num_envs": num_envs, "rollout_length": rollout_length}
    for name, size in sizes.items():
        check_size(name, size)
    spelled = f"rollout_length * num_envs = {rollout_length} * {num_envs}"
    agent.check_batch(rollout_length * num_envs, spelled)
