"""What every place that metrics go to has in common."""

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from hitmdp_jax.errors import warn
from hitmdp_jax.learning.options import mean_duration
from hitmdp_jax.metrics import VOCABULARY, describe

Values = dict[str, np.ndarray]  # metric -> [S] or [S, K]; NaN where a seed has none


class Sink(Protocol):
    """A place that metrics go to."""

    name: str

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Take the metrics of one report, which ends with `iteration`, counted from 1."""
        ...

    def flush(self) -> None:
        """Make sure that what was written outlives this process; as it stands, it does."""

    def close(self) -> None:
        """Finish writing."""
        ...


class Sinks(Sink):
    """Several sinks as one. A failing one is told once and left out; training goes on."""

    name = "all"

    def __init__(self, *sinks: Sink):
        self._sinks = list(sinks)

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Hand the metrics on."""
        self._each(lambda sink: sink.write(iteration, env_steps, metrics))

    def flush(self) -> None:
        """Flush every sink."""
        self._each(lambda sink: sink.flush())

    def close(self) -> None:
        """Close every sink."""
        self._each(lambda sink: sink.close())

    def _each(self, action: Callable[[Sink], None]) -> None:
        for sink in list(self._sinks):
            try:
                action(sink)
            except Exception as error:  # a full disk, a closed terminal, a server that is gone
                self._leave_out(sink, error)

    def _leave_out(self, sink: Sink, error: Exception) -> None:
        self._sinks.remove(sink)
        warn(f"{sink.name} takes no more metrics: {error or type(error).__name__}")


def columns(metrics: Values) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each metric as columns [S]: vectors [S, K] become `name_0`, `name_1`, ..."""
    for name, x in metrics.items():
        if x.ndim == 1:
            yield name, x
        else:
            yield from ((f"{name}_{k}", x[:, k]) for k in range(x.shape[1]))


def curves(metrics: Values) -> Iterator[tuple[str, np.ndarray]]:
    """Return each metric as columns [S] whose names are `group/name`, for services with curves.

    An option's counts become its share of the steps and how many steps it lasts on average, and
    divergences and clipping have the names that users of PPO look for: `train/approx_kl_action`.
    """
    shown, named = dict(metrics), {}
    if "option_steps" in shown and "option_activations" in shown:
        steps, activations = shown.pop("option_steps"), shown.pop("option_activations")
        named["options/share"] = steps / np.maximum(steps.sum(-1, keepdims=True), 1.0)
        named["options/duration"] = mean_duration(steps, activations)
    named |= {f"{describe(name).group}/{_known_name(name)}": x for name, x in shown.items()}
    return columns(named)


def _known_name(name: str) -> str:
    """Return the name under which a policy's divergence or clipping is known elsewhere."""
    for ending, known in (("_kl", "approx_kl"), ("_clip_fraction", "clip_fraction")):
        if describe(name) is VOCABULARY[f"*{ending}"]:
            return f"{known}_{name.removesuffix(ending)}"
    return name
