"""Visited states, and what the parts of a policy say in them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.distance import cdist

from hitmdp_jax.agents.hit_policy import HitPolicy
from hitmdp_jax.agents.option_agent import OptionAgent
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.runs.policy import Policy

MOST_STATES = 2048


class States(NamedTuple):
    """S steps of recorded episodes."""

    obs: np.ndarray  # [S, O] raw
    option: np.ndarray  # [S] int, o_t
    previous: np.ndarray  # [S] int, o_{t-1}; o_t itself at an episode's start
    step: np.ndarray  # [S] int, t
    episode: np.ndarray  # [S] int, n


def visited(recorded: Trajectories, most: int = MOST_STATES) -> States:
    """Return the steps of all episodes, or `most` of them, evenly spread."""
    option = np.asarray(recorded.option)
    previous = np.concatenate([option[:1], option[:-1]])
    step, episode = np.meshgrid(*map(np.arange, option.shape), indexing="ij")
    everything = np.asarray(recorded.obs), option, previous, step, episode
    steps = np.flatnonzero(np.asarray(recorded.alive).T)  # one episode after the other
    chosen = steps[np.linspace(0, len(steps) - 1, min(most, len(steps))).astype(int)]
    return States(*(x.swapaxes(0, 1).reshape(-1, *x.shape[2:])[chosen] for x in everything))


@jax.jit
def attention(policy: Policy, states: States) -> jax.Array | None:
    """Return how much the master policy attends to each option's embedding, [S, K].

    These are the weights of the softmax in the option encoder; with the similarity form, an
    option's own similarity to the query counts beside them. None of agents without embeddings.
    """
    agent = policy.agent
    if not isinstance(agent, HitPolicy):
        return None
    return agent.attention(
        policy.params, policy.normalized(states.obs), jnp.asarray(states.previous)
    )


@jax.jit
def terminations(policy: Policy, states: States) -> jax.Array | None:
    """Return each option's probability to end, beta_o(s) [S, K]; None of agents without."""
    agent = policy.agent
    if not isinstance(agent, OptionAgent):
        return None
    return jax.nn.sigmoid(agent.heads(policy.params, policy.normalized(states.obs)).termination)


def typical(points: np.ndarray, option: np.ndarray) -> dict[int, int]:
    """Return the state of each option around which its states lie most densely.

    A tenth of the option's states lie nearer to it than to any other of them. The one in the middle
    of all, the medoid, would be no such state: of a body that runs, it is one that stands still.

    Args:
      points: the states [S, D], as the policy sees them.
      option: the option that acted in each [S].

    Returns:
      option -> the index of its state; options that never acted have none.
    """
    found = {}
    for k in np.unique(option).tolist():
        (own,) = np.nonzero(option == k)
        near = min(-(-len(own) // 10), len(own) - 1)  # of the others
        reach = np.partition(cdist(points[own], points[own]), near, axis=1)[:, near]
        found[k] = int(own[reach.argmin()])
    return found


def cosine_similarities(rows: np.ndarray) -> np.ndarray:
    """Return the cosines of the angles between rows [K, E], [K, K]."""
    unit = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
    return unit @ unit.T


def by_option(values: np.ndarray, option: np.ndarray) -> np.ndarray:
    """Return the means [K, K] of values [S, K] over the states of each option [S]; NaN of none."""
    means = np.full((values.shape[1], values.shape[1]), np.nan)
    for k in np.unique(option):
        means[k] = values[option == k].mean(axis=0)
    return means
