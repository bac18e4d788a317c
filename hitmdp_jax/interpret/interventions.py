"""Do the options differ, and do they matter? Their divergence, and episodes with other choices.

What an option does to the return is asked by an intervention: the same initial states, the same
P(a | s, o), and options that the master policy did not choose.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env
from numpy.typing import ArrayLike
from scipy import stats

from hitmdp_jax.interpret.episodes import Trajectories, run_episodes
from hitmdp_jax.interpret.option_use import activations, number_of_options
from hitmdp_jax.interpret.statistics import CONFIDENCE
from hitmdp_jax.runs.policy import Policy

OWN, SHUFFLED, UNIFORM = "own choices", "own, shuffled", "uniform choices"
HELD, FROZEN = "uniform, held", "first choice"
# What `summary` tells.
OF_CHOICES = (
    "own_choices",
    "shuffled_choices",
    "uniform_choices",
    "held_choices",
    "first_choice",
)
OF_OPTIONS = ("best_option", "worst_option")
# Nats: options that are less apart are practically identical, for it takes hundreds of steps to
# tell them from each other; a few steps tell options that are so much apart as DISTINCT.
IDENTICAL, DISTINCT = 0.01, 1.0
LISTED = 6  # pairs of options that a sentence names
WITHOUT_EACH_OPTION = 4  # interventions beside the K that keep an option throughout


class Interventions(NamedTuple):
    """Whole episodes under each way of choosing options, M of them, from the same N states."""

    names: tuple[str, ...]  # the policy's own choices first, each option alone last
    returns: np.ndarray  # [M, N] undiscounted
    lengths: np.ndarray  # [M, N] control steps
    # [K, T, 1, ...] the first episode under each option alone, with what pictures need; None unless
    # that was asked for.
    alone: Trajectories | None = None

    @property
    def num_options(self) -> int:
        """K, how many of the ways keep an option throughout."""
        return len(self.names) - 1 - WITHOUT_EACH_OPTION


class Effects(NamedTuple):
    """Mean returns under each way of choosing options, and what they differ by from the first.

    A difference is of pairs of episodes that start in the same state.
    """

    mean: np.ndarray  # [M]
    difference: np.ndarray  # [M] the mean minus that of the policy's own choices
    half_width: np.ndarray  # [M] of the difference's 95% interval (Student's t); NaN of one episode


@jax.jit
def divergence(policy: Policy, obs: jax.Array) -> jax.Array:
    """Return how far the options' actions are apart, [K, K] in nats, the mean over states.

    Half the sum of the two Kullback-Leibler divergences of P(a | s, i) and P(a | s, j). Two options
    are told apart by the actions of n steps once n times their divergence is a few nats.

    Args:
      policy: of an agent with options.
      obs: raw observations [S, O].

    Raises:
      UsageError: the agent has no options.
    """
    every = jnp.arange(number_of_options(policy.agent))
    states = policy.normalized(obs)[:, None, None]
    first, second = (
        policy.agent.policy(policy.params, states, options)  # over [S, K, 1] and [S, 1, K]
        for options in (every[:, None], every)
    )
    directed_divergence = first.kl_divergence(second).mean(axis=0)
    return 0.5 * (directed_divergence + directed_divergence.T)


def alike(divergence: np.ndarray) -> str:
    """Say which options are practically identical, by how far they are apart, [K, K] in nats."""
    first, second = np.triu_indices(len(divergence), 1)
    close = divergence[first, second] < IDENTICAL
    bound = f"{IDENTICAL:g} nats apart"
    if close.all():
        return f"The options are practically identical: no two of them are {bound}."
    if not close.any():
        return f"No two options are practically identical: all are at least {bound}."
    pairs = [f"{i} and {j}" for i, j in zip(first[close], second[close], strict=True)]
    named = pairs[:LISTED] + [f"{len(pairs) - LISTED} more pairs"] * (len(pairs) > LISTED)
    return f"Practically identical, less than {bound}: options {'; '.join(named)}."


def intervene(
    policy: Policy,
    env: Env,
    key: jax.Array,
    own: Trajectories,
    *,
    deterministic: bool = False,
    physics: bool = False,
) -> Interventions:
    """Run a policy's episodes again with other choices of options.

    All of them are schedules, so one program runs them side by side: M N environments.

    Args:
      policy: of an agent with options.
      env: the task, unbatched and without auto-reset.
      key: that of `own`, so that the episodes start in the same states.
      own: the policy's own episodes, as `run_episodes` gave them.
      deterministic: take the likeliest action instead of sampling; as for `own`.
      physics: keep what pictures need of the first episode under each option alone.

    Raises:
      UsageError: the agent has no options.
    """
    seed = int(jax.random.bits(key))
    num_options = number_of_options(policy.agent)
    plans = schedules(np.asarray(own.option), own.alive, num_options, np.random.default_rng(seed))
    stacked = jnp.asarray(np.stack(list(plans.values())), jnp.int32)
    *episodes, first = jax.device_get(_episodes(policy, env, key, stacked, deterministic, physics))
    mine = own.returns, own.lengths
    returns, lengths = (
        np.concatenate([np.asarray(x)[None], np.asarray(y)])
        for x, y in zip(mine, episodes, strict=True)
    )
    alone = jax.tree.map(lambda x: x[-num_options:], first)
    return Interventions((OWN, *plans), returns, lengths, alone)


@functools.partial(jax.jit, static_argnames=("env", "deterministic", "physics"))
def _episodes(
    policy: Policy,
    env: Env,
    key: jax.Array,
    plans: jax.Array,
    deterministic: bool,
    physics: bool,
) -> tuple[jax.Array, jax.Array, Trajectories | None]:
    """Return the returns and lengths of episodes under plans [M, T, N], [M, N] each.

    With `physics`, the first episode under each plan comes third, [M, T, 1, ...]; else None.
    """

    def run(plan: jax.Array) -> tuple[jax.Array, jax.Array, Trajectories | None]:
        how = {"options": plan, "deterministic": deterministic, "physics": physics, "pictured": 1}
        recorded = run_episodes(policy, env, key, plan.shape[1], **how)
        first = recorded.episode(0) if physics else None
        return recorded.returns, recorded.lengths, first

    return jax.vmap(run)(plans)


def schedules(
    option: ArrayLike, alive: ArrayLike, num_options: int, random: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return the other choices of options by name, as schedules [T, N].

    - the policy's own activations of each episode in a random order: as much of each option, at
      other moments;
    - a uniform choice at every step;
    - a uniform choice at every activation of the policy's own, in a random order: options that last
      as long as the policy's own, and that nobody chose;
    - the first choice of each episode, kept;
    - each option throughout.

    Args:
      option: [T, N], those that the policy chose.
      alive: [T, N] bool, the step belongs to the episode.
      num_options: K.
      random: what draws.
    """
    option = np.asarray(option)
    return {
        SHUFFLED: shuffled(option, alive, random),
        UNIFORM: random.integers(num_options, size=option.shape),
        HELD: held(option, alive, num_options, random),
        FROZEN: np.broadcast_to(option[0], option.shape),
        **{f"option {k}": np.full_like(option, k) for k in range(num_options)},
    }


def shuffled(option: ArrayLike, alive: ArrayLike, random: np.random.Generator) -> np.ndarray:
    """Return each episode's activations in a random order, [T, N].

    Where two of one option meet they make a longer one. Beyond the episode's own length come
    further orders of the same activations.
    """

    def orders(chosen: np.ndarray, duration: np.ndarray) -> np.ndarray:
        order = random.permutation(len(chosen))
        return np.repeat(chosen[order], duration[order])

    return _filled(option, alive, orders)


def held(
    option: ArrayLike, alive: ArrayLike, num_options: int, random: np.random.Generator
) -> np.ndarray:
    """Return options drawn uniformly, each for as long as one of the episode's activations, [T, N].

    The durations come in a random order, and as in `shuffled` beyond the episode's own length.
    """

    def draws(chosen: np.ndarray, duration: np.ndarray) -> np.ndarray:
        drawn = random.integers(num_options, size=len(chosen))
        return np.repeat(drawn, random.permutation(duration))

    return _filled(option, alive, draws)


def _filled(
    option: ArrayLike, alive: ArrayLike, pieces: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return plans [T, N], each column put together of what `pieces` makes of the activations."""
    steps, columns = len(np.asarray(option)), []
    for episode in activations(option, alive):
        column = np.zeros(0, int)
        while len(column) < steps:
            column = np.append(column, pieces(episode.option, episode.duration))
        columns.append(column[:steps])
    return np.stack(columns, axis=1)


def effects(interventions: Interventions) -> Effects:
    """Return the mean returns and their differences to the policy's own choices."""
    returns = interventions.returns.astype(float)
    difference = returns - returns[0]
    n = returns.shape[1]
    half = np.full(len(returns), np.nan)
    if n > 1:
        error = difference.std(axis=1, ddof=1) / np.sqrt(n)
        half = stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * error
    return Effects(returns.mean(axis=1), difference.mean(axis=1), half)


def summary(interventions: Interventions) -> dict[str, float]:
    """Return the mean returns that tell whether options matter, by the name of a column.

    The best and the worst single option are picked by the same episodes: of equal options, the
    first looks a little better than it is and the second a little worse.
    """
    mean = effects(interventions).mean
    chosen, alone = mean[: -interventions.num_options], mean[-interventions.num_options :]
    values = (*chosen, alone.max(), alone.min())
    return dict(zip((*OF_CHOICES, *OF_OPTIONS), map(float, values), strict=True))


def table(interventions: Interventions) -> list[list[str]]:
    """Return the interventions as rows of text, the header first."""
    rows = [["options", "return", "minus own choices", "95% interval"]]
    for i, (name, mean, difference, half) in enumerate(
        zip(interventions.names, *effects(interventions), strict=True)
    ):
        interval = f"{difference - half:+z.1f} to {difference + half:+z.1f}"
        against = (f"{difference:+z.1f}", "-" if np.isnan(half) else interval)
        rows.append([name, f"{mean:z.1f}", *(against if i else ("-", "-"))])
    return rows
