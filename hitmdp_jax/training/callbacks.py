"""One's own code while a run goes on: what it is given, and what it may do."""

import abc
import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from hitmdp_jax.checks import whole_number
from hitmdp_jax.errors import UsageError, out_of_domain
from hitmdp_jax.metrics import REWARD_TERM, describe
from hitmdp_jax.training.policy import Policy

COUNTED = ("iteration", "env_steps", "seed")  # columns of a table of metrics that are no metrics


@dataclasses.dataclass
class Moment:
    """Where a run stands that trains R seeds, or settings, side by side.

    Attributes:
      env_steps: environment steps of each training until now.
      iteration: how many iterations that was.
      metrics: of the last report, [R] each, or [R, K] of what each option has.
      policy: of all trainings, its leaves [R, ...]; `policy.of(0)` is the first one's.
      stopped: why the run is to stop, once somebody has said so.
    """

    env_steps: int
    iteration: int
    metrics: Mapping[str, np.ndarray]
    policy: Policy
    stopped: str | None = None

    def stop(self, reason: str = "a callback asked for it") -> None:
        """End the run after this report; it is saved as it is."""
        self.stopped = reason


class Callback(abc.ABC):
    """Something to do every so often while a run goes on.

    Attributes:
      every: environment steps of a training between two calls; it is called after whole reports.
      names: the metrics that it returns.
    """

    every: int = 10_000
    names: tuple[str, ...] = ()

    @abc.abstractmethod
    def __call__(self, now: Moment) -> Mapping[str, Any] | None:
        """Do it; return metrics by name, a number or [R] each, or nothing."""

    def close(self) -> None:  # noqa: B027
        """Finish: the run has ended."""


class StopAtReturn(Callback):
    """Stops a run once each training's mean return of its last 100 episodes is high enough.

    One that diverged is not waited for.

    Args:
      least: the return.

    Raises:
      UsageError: it is no number.
    """

    every = 1  # which is each report

    def __init__(self, least: float):
        if isinstance(least, bool) or not isinstance(least, int | float) or math.isnan(least):
            raise out_of_domain("stop_at_return", least, "a number")
        self.least = least

    def reached(self, metrics: Mapping[str, np.ndarray]) -> bool:
        """Return whether the trainings have come so far, by their metrics [R] of a report."""
        returns = metrics["recent_return"][metrics["diverged"] == 0]
        return len(returns) > 0 and bool((returns >= self.least).all())

    def __call__(self, now: Moment) -> None:
        """Stop the run, or do nothing."""
        if self.reached(now.metrics):
            now.stop(f"the mean return of the last episodes reached {self.least:g}")


def check_callback(callback: Any, name: str) -> Callback:
    """Return a callback that a run can call, with its period and its metrics.

    Raises:
      UsageError: it is no callback, or `every` or `names` of it cannot be used.
    """
    if isinstance(callback, type):
        raise UsageError(f"callbacks holds the class {name}: pass a callback, {name}().")
    if not isinstance(callback, Callback):
        raise UsageError(f"{name} is no callback: derive it from hitmdp_jax.Callback.")
    whole_number(f"every of {name}", callback.every, at_least=1)
    names = callback.names
    listed = isinstance(names, tuple | list)
    if not listed or not all(isinstance(x, str) and x.isidentifier() for x in names):
        raise out_of_domain(f"names of {name}", names, "a tuple of words, such as ('my_metric',)")
    for metric in names:
        if metric in COUNTED or describe(metric) is not REWARD_TERM:
            raise UsageError(f"{name}'s metric '{metric}' has the name of a run's own: rename it.")
    return callback


def check_callbacks(
    callbacks: Iterable[tuple[Any, str]], stop_at_return: float | None = None
) -> list[Callback]:
    """Return the hooks that a run calls, made from callbacks with their names in messages.

    Args:
      callbacks: one's own.
      stop_at_return: a return that ends the run, see `StopAtReturn`; None: none does.

    Raises:
      UsageError: as `check_callback`, two share a metric's name, or the return is no number.
    """
    found = [check_callback(*named) for named in callbacks]
    names = [metric for callback in found for metric in callback.names]
    for metric in names:
        if names.count(metric) > 1:
            raise UsageError(f"Callbacks have the metric '{metric}' twice: rename one of them.")
    return found if stop_at_return is None else [*found, StopAtReturn(stop_at_return)]


def told(callback: Callback, now: Moment) -> dict[str, np.ndarray]:
    """Call a callback; return its metrics [R].

    Raises:
      UsageError: what it returns are not the metrics that it names, or no numbers.
    """
    name, size = type(callback).__name__, len(now.metrics["diverged"])
    found = callback(now)
    if found is None:
        return {}
    if not isinstance(found, Mapping):
        raise UsageError(f"{name} returned a {type(found).__name__}: return metrics by name.")
    values = {}
    for metric, x in found.items():
        if metric not in callback.names:
            raise UsageError(f"{name} returned a metric '{metric}' that its `names` do not list.")
        if metric in now.metrics:
            raise UsageError(f"{name}'s metric '{metric}' has the name of a run's own: rename it.")
        try:
            values[metric] = np.broadcast_to(np.asarray(x, float), (size,))
        except (TypeError, ValueError):
            raise UsageError(
                f"{name}'s metric '{metric}' must be a number, or one for each of {size} trainings."
            ) from None
    return values
