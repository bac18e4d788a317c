"""All that a training consists of between two iterations."""

from typing import Any

import jax
from brax.training.acme.running_statistics import RunningStatisticsState
from flax import struct

from hitmdp_jax.agents.base import LearnerState
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.learning.episodes import EpisodeWindow
from hitmdp_jax.learning.rollout import RolloutState

# A float hyperparameter, or `env.` and a number of the task's, -> its value.
Hyperparameters = dict[str, jax.Array]


class TrainState(struct.PyTreeNode):
    """Everything a training run consists of: continuing from it is exact."""

    hyperparameters: Hyperparameters  # of this training, in place of the agent's own
    learner: LearnerState
    replay: Any  # what an off-policy agent remembers of rollouts; () of the others
    normalizer: RunningStatisticsState
    rollout: RolloutState
    episodes: EpisodeWindow
    key: jax.Array
    iteration: jax.Array  # int32
    diverged: jax.Array  # int32, the iteration that was not finite; 0 while all are
    cause: jax.Array  # int32, the place in CAUSES of what was not finite
    spec: Spec = struct.field(pytree_node=False)  # of the task


def transfer(old: TrainState, new: TrainState) -> TrainState:
    """Carry what was learned over to another task's fresh state.

    Networks, optimiser and observation normaliser go on; environments, memory, the replay and the
    episodes in progress start anew (DAC, Zhang & Whiteson 2019, sec. 5.2, without its carried-over
    episodes).
    """
    return new.replace(
        hyperparameters=old.hyperparameters,
        learner=old.learner,
        normalizer=old.normalizer,
        key=old.key,
        iteration=old.iteration,
        diverged=old.diverged,
        cause=old.cause,
    )
