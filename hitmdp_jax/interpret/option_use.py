"""What options do in recorded episodes: how long, how often, and which after which.

The functions of episodes are pure and take `option` [T, N] and `alive` [T, N] as `Trajectories`
hold them: option numbers, and whether the step belongs to the episode. An activation is a run of
steps under one option; the episode's end cuts the last one short, and it counts as long as it
lasted.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hitmdp_jax.agents.base import Agent
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.visited_states import by_option
from hitmdp_jax.learning.options import mean_duration


class Activations(NamedTuple):
    """The activations of one episode in order, M of them."""

    option: np.ndarray  # [M] int
    start: np.ndarray  # [M] int, the first step
    duration: np.ndarray  # [M] int, steps


def number_of_options(agent: Agent) -> int:
    """Return K.

    Raises:
      UsageError: the agent has no options, or none that can be chosen from outside.
    """
    number, kind = getattr(agent, "num_options", None), type(agent)
    if not isinstance(number, int) or kind.policy is Agent.policy:
        raise UsageError(f"{kind.__name__} has no options to look into.")
    return number


def activations(option: ArrayLike, alive: ArrayLike) -> list[Activations]:
    """Return the sequence of activations of each episode, N of them."""
    option, alive = np.asarray(option), np.asarray(alive, bool)
    sequences = []
    for n, length in enumerate(alive.sum(axis=0)):
        start = np.flatnonzero(_activated(option, alive)[:, n])
        duration = np.diff(start, append=length)
        sequences.append(Activations(option[start, n], start, duration))
    return sequences


def durations(option: ArrayLike, alive: ArrayLike, num_options: int) -> np.ndarray:
    """Return each option's mean duration in steps in each episode, [N, K]; NaN if it never ran."""
    option, alive = np.asarray(option), np.asarray(alive, bool)
    chosen = option[..., None] == np.arange(num_options)
    steps = (chosen & alive[..., None]).sum(axis=0)
    starts = (chosen & _activated(option, alive)[..., None]).sum(axis=0)
    return mean_duration(steps, starts)


def usage(option: ArrayLike, alive: ArrayLike, num_options: int) -> np.ndarray:
    """Return each option's share of all steps, [K]."""
    taken = np.asarray(option)[np.asarray(alive, bool)]
    return np.bincount(taken, minlength=num_options) / taken.size


def transition_matrix(option: ArrayLike, alive: ArrayLike, num_options: int) -> np.ndarray:
    """Return the share of steps under option j among those that follow one under i, [K, K].

    The diagonal holds the steps that keep their option. A row is NaN where nothing follows i.
    """
    return mean_after(option, alive, np.eye(num_options)[np.asarray(option)])


def mean_after(option: ArrayLike, alive: ArrayLike, values: ArrayLike) -> np.ndarray:
    """Return the mean of values [T, N, K] over the steps that follow one under each option, [K, K].

    A row is NaN where nothing follows its option.
    """
    both = np.asarray(alive, bool)[1:]
    return by_option(np.asarray(values)[1:][both], np.asarray(option)[:-1][both])


def _activated(option: np.ndarray, alive: np.ndarray) -> np.ndarray:
    """Return which steps [T, N] start an activation."""
    switched = np.diff(option, axis=0, prepend=option[:1]) != 0
    switched[:1] = True
    return switched & alive
