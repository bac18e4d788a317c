"""How long a training is, and how large what it draws: sizes that shape the program."""

from typing import Any

from hitmdp_jax.agents.base import Agent
from hitmdp_jax.checks import check_size

POOL_ACTIONS = 32  # in each environment, at least, between two drawings of fresh initial states


def num_iterations(
    num_steps: int, num_envs: int, rollout_length: int, action_repeat: int = 1
) -> int:
    """Return how many iterations cover `num_steps` environment steps, the last one whole.

    Environment steps are control steps: `action_repeat` to an action.
    """
    return -(-num_steps // (num_envs * rollout_length * action_repeat))


def pool_period(rollout_length: int) -> int:
    """Return after how many iterations fresh initial states are drawn again.

    An agent that updates at every step would spend its time on drawing them.
    """
    return -(-POOL_ACTIONS // rollout_length)


def usual_pool_size(num_envs: int, rollout_length: int) -> int:
    """Return how many fresh initial states are drawn at once: a quarter of the steps until then."""
    return max(1, num_envs * rollout_length * pool_period(rollout_length) // 4)


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
