"""What a policy's options are and do, in one object: each answer is computed when first read."""

import dataclasses
import functools

import jax
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.envs.drawing import can_be_drawn
from hitmdp_jax.envs.spec import Spec, spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret import option_use
from hitmdp_jax.interpret.episodes import Trajectories, run_episodes
from hitmdp_jax.interpret.evaluation import check_episodes, check_fit
from hitmdp_jax.interpret.interventions import Interventions, divergence, intervene
from hitmdp_jax.interpret.option_use import number_of_options
from hitmdp_jax.interpret.perturbation import Perturbation, embeddings, perturb
from hitmdp_jax.interpret.projection import Projection, project
from hitmdp_jax.interpret.visited_states import (
    States,
    attention,
    terminations,
    typical,
    visited,
)
from hitmdp_jax.runs.policy import Policy

DECODED_STATES = 256  # states in which perturbed options are decoded


@dataclasses.dataclass(frozen=True, eq=False)
class OptionAnalysis:
    """What the options of a policy are and do in episodes of its own.

    All answers are NumPy arrays of the same recorded episodes. Those about embeddings are None of
    agents that have none, as terminations are of agents whose options do not terminate.

    Args:
      policy: of an agent with options.
      env: the task, unbatched and without auto-reset.
      key: PRNG key of initial states and actions.
      episodes: N, how many are recorded.
      deterministic: take the likeliest option and action instead of sampling.

    Raises:
      UsageError: the agent has no options, the policy does not fit the task, or episodes < 1.
    """

    policy: Policy
    env: Env
    key: jax.Array
    episodes: int = 8
    deterministic: bool = False

    def __post_init__(self) -> None:
        number_of_options(self.policy.agent)
        check_episodes(self.episodes)
        check_fit(self.policy, self.env)

    @property
    def num_options(self) -> int:
        """Return K."""
        return number_of_options(self.policy.agent)

    def check_several_options(self) -> None:
        """Raise UsageError where there is nothing to tell apart."""
        if self.num_options == 1:
            raise UsageError("The policy has one option.")

    def without(self, what: str) -> UsageError:
        """Return the error that the agent lacks what was asked for."""
        return UsageError(f"{type(self.policy.agent).__name__} has no {what} to draw.")

    @functools.cached_property
    def spec(self) -> Spec:
        """What the task says of itself, the names of observations and actions among it."""
        return spec_of(self.env)

    @functools.cached_property
    def trajectories(self) -> Trajectories:
        """The policy's own episodes, [T, N, ...]; with what pictures need where it can be drawn."""
        how = {"deterministic": self.deterministic, "physics": can_be_drawn(self.env)}
        return jax.device_get(run_episodes(self.policy, self.env, self.key, self.episodes, **how))

    @functools.cached_property
    def states(self) -> States:
        """The states that the following speak of."""
        return visited(self.trajectories)

    @property
    def _taken(self) -> tuple[np.ndarray, np.ndarray]:
        """The options [T, N], and which steps belong to an episode."""
        return np.asarray(self.trajectories.option), np.asarray(self.trajectories.alive)

    @property
    def activations(self) -> list[option_use.Activations]:
        """The sequence of activations of each episode."""
        return option_use.activations(*self._taken)

    @property
    def durations(self) -> np.ndarray:
        """Each option's mean duration in each episode, [N, K]; NaN where it never ran."""
        return option_use.durations(*self._taken, self.num_options)

    @property
    def usage(self) -> np.ndarray:
        """Each option's share of all steps, [K]."""
        return option_use.usage(*self._taken, self.num_options)

    @property
    def by_usage(self) -> np.ndarray:
        """The options, those used most first, [K]."""
        return np.argsort(-self.usage, kind="stable")

    @property
    def transitions(self) -> np.ndarray:
        """The share of steps under j among those after one under i, [K, K]."""
        return option_use.transition_matrix(*self._taken, self.num_options)

    @property
    def choices(self) -> np.ndarray | None:
        """The master's P(o_t = j | s_t, o_{t-1} = i), mean over the visited s_t, [K, K], or None.

        `transitions` counts what was drawn with these probabilities.
        """
        option, alive = self._taken
        probs = self.trajectories.option_probs
        return None if probs is None else option_use.mean_after(option, alive, probs)

    @functools.cached_property
    def divergence(self) -> np.ndarray:
        """How far the options' actions are apart, [K, K] in nats."""
        return np.asarray(divergence(self.policy, self.states.obs))

    @functools.cached_property
    def interventions(self) -> Interventions:
        """Returns of episodes with other choices of options, from the same states."""
        how = {"deterministic": self.deterministic, "physics": can_be_drawn(self.env)}
        return intervene(self.policy, self.env, self.key, self.trajectories, **how)

    @functools.cached_property
    def projection(self) -> Projection:
        """The states as the policy sees them, in two dimensions."""
        return project(np.asarray(self.policy.normalized(self.states.obs)))

    @functools.cached_property
    def typical(self) -> dict[int, int]:
        """The state that is typical of each option that acts, by its index in `states`."""
        return typical(np.asarray(self.policy.normalized(self.states.obs)), self.states.option)

    @property
    def embeddings(self) -> np.ndarray | None:
        """W [K, E], or None."""
        return embeddings(self.policy)

    @functools.cached_property
    def perturbation(self) -> Perturbation | None:
        """What each dimension of each embedding does to the actions, or None."""
        obs = visited(self.trajectories, DECODED_STATES).obs
        return perturb(self.policy, obs)

    @functools.cached_property
    def attention(self) -> np.ndarray | None:
        """How much the master attends to each option in each of the states, [S, K], or None."""
        return _array(attention(self.policy, self.states))

    @functools.cached_property
    def terminations(self) -> np.ndarray | None:
        """Each option's probability to end in each of the states, [S, K], or None."""
        return _array(terminations(self.policy, self.states))


def _array(x: jax.Array | None) -> np.ndarray | None:
    return None if x is None else np.asarray(x)
