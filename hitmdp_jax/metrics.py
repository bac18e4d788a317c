"""The one vocabulary of metrics: meaning, unit, and how iterations are summed up."""

import dataclasses
import fnmatch
from typing import Literal

import jax
import jax.numpy as jnp

Metrics = dict[str, jax.Array]


@dataclasses.dataclass(frozen=True)
class Metric:
    """A metric, or all that a pattern such as `*_kl` names.

    "by episodes" is the mean weighted by the episodes that each value is a mean of. Where nothing
    was measured a value is NaN, which no mean over seeds counts, except where a metric has a
    `cause`: it is always measured, and one that is not finite means that the training diverged.
    TensorBoard and Weights & Biases show the metrics of a `group` together.
    """

    meaning: str
    unit: str = ""
    over_iterations: Literal["mean", "sum", "by episodes", "last"] = "mean"
    cause: Literal["", "loss", "policy"] = ""  # of a divergence, where it is not finite
    group: Literal["return", "options", "train", "time", "task"] = "train"


def of_policy(meaning: str, unit: str) -> Metric:
    """Return a metric that every iteration has while the policy's numbers are finite."""
    return Metric(meaning, unit, cause="policy")


VOCABULARY: dict[str, Metric] = {
    # Episodes.
    "episodes": Metric("whole episodes that ended", "episodes", "sum", group="return"),
    "episode_return": Metric(
        "undiscounted reward of the whole episodes that ended, of the stochastic training policy",
        "reward",
        "by episodes",
        group="return",
    ),
    "episode_length": Metric("their length", "control steps", "by episodes", group="return"),
    "success": Metric(
        "whole episodes that ended in which the goal was reached",
        "share of episodes",
        "by episodes",
        group="return",
    ),
    "step_reward": Metric(
        "mean reward of an action, in whole episodes or not", "reward", group="return"
    ),
    "recent_return": Metric(
        "mean return of a seed's last 100 episodes", "reward", "last", group="return"
    ),
    "recent_length": Metric("their mean length", "control steps", "last", group="return"),
    # The run.
    "steps_per_second": Metric("control steps of one seed per second", "1/s", "last", group="time"),
    "diverged": Metric("1 once a seed's parameters are not finite", "seeds", "last"),
    "unstable": Metric("steps in which the simulation was lost", "share of steps", group="task"),
    # Options, [K].
    "option_steps": Metric("actions that each option chose", "actions", "sum", group="options"),
    "option_activations": Metric("times that each option was taken up", "", "sum", group="options"),
    # Policies.
    "action_entropy": of_policy("entropy of the action policy of the option followed", "nats"),
    "option_entropy": of_policy("entropy of P(o_t | s_t, o_{t-1})", "nats"),
    "master_entropy": of_policy("entropy of pi(o | s), who chooses where an option ends", "nats"),
    "belief_entropy": of_policy("entropy of P(o_t | s_0..s_t, a_0..a_{t-1})", "nats"),
    "termination": of_policy("mean beta_{o_t}(s_{t+1}), the probability to end", "probability"),
    "prior_kl": of_policy("KL of P(o_t | s_t, o_{t-1}) from the sticky prior", "nats"),
    "master_distance": of_policy("KL of the master network from the best master policy", "nats"),
    "temperature": of_policy("what a nat of the action policy's entropy is worth", "reward/nat"),
    "option_weight": of_policy("what a nat of divergence from the prior costs", "reward/nat"),
    "learned_information": Metric("log q(o | where it led) + log K of learned rewards", "nats"),
    "information": of_policy("mean I_t of the ELBO (HiT-MDP, Thm 4.1), unweighted", "nats"),
    # Learning.
    "loss": Metric("what the gradients are of, over all minibatches", cause="loss"),
    "*_kl": Metric("KL(old || new) of the policy of that name, over all minibatches", "nats"),
    "*_clip_fraction": Metric("samples whose ratio left the clipping interval", "share of samples"),
    "learning_rate": Metric("Adam's, where it follows the KL", ""),
    "value": Metric("mean value of the states visited, V[s, o_{t-1}] with options", "return"),
    "value_loss": Metric("half the squared error of the critic", "return^2"),
    "explained_variance": Metric(
        "1 - Var(target - value) / Var(target): 1 of a perfect critic, 0 of a constant one", "share"
    ),
    "q_loss": Metric("half the squared error of Q[s, o], where V is fitted as well", "return^2"),
    "termination_loss": Metric("beta times the advantage of going on", "return"),
}

REWARD_TERM = Metric(
    "a term of the task's reward, or whatever else the task reports", "reward", group="task"
)


def describe(name: str) -> Metric:
    """Return the meaning of a metric's name; an unknown name belongs to the task."""
    if name in VOCABULARY:
        return VOCABULARY[name]
    patterns = (metric for key, metric in VOCABULARY.items() if fnmatch.fnmatchcase(name, key))
    return next(patterns, REWARD_TERM)


def over_iterations(stacked: Metrics) -> Metrics:
    """Reduce metrics [iterations, ...] to one value each; pure, for use inside a program."""

    def reduced(name: str, x: jax.Array) -> jax.Array:
        how = describe(name).over_iterations
        if how == "sum":
            return x.sum(axis=0)
        if how == "last":
            return x[-1]
        if how == "by episodes":
            weight = stacked["episodes"]
            return jnp.where(weight > 0, x * weight, 0.0).sum(axis=0) / weight.sum(axis=0)
        return x.mean(axis=0)

    return {name: reduced(name, x) for name, x in stacked.items()}
