"""`callbacks=`: a user's own code, called while a run goes on."""

import inspect
from pathlib import Path
from typing import Any

import jax
import numpy as np

from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Progress, saved_iterations
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.metrics import read_metrics
from hitmdp_jax.runs.sinks import Values
from hitmdp_jax.training.callbacks import Callback, Moment, StopAtReturn, check_callbacks, told
from hitmdp_jax.training.policy import Policy


class OwnCode:
    """Calls a callback of the user's as a hook of the run.

    Args:
      callback: what is called.
      config: the run's settings.
    """

    def __init__(self, callback: Callback, config: RunConfig):
        self.every, self.names = callback.every, tuple(callback.names)
        self._callback, self._config = callback, config
        self.stopped: str | None = None  # why the run is to stop

    def __call__(self, progress: Progress, env_steps: int) -> Values:
        """Return the callback's metrics [R]; Raises as `told`, and what it raises."""
        size = len(self._config.trainings)
        metrics = {name: np.asarray(x)[:size] for name, x in progress.report.items()}
        policy = learned(self._config, progress)
        now = Moment(env_steps, progress.iteration, metrics, policy)
        found = told(self._callback, now)
        self.stopped = now.stopped
        return dict(found)

    def close(self, stop: StopRequest) -> None:
        """Let the callback finish, where it has something to."""
        self._callback.close()


def learned(config: RunConfig, progress: Progress) -> Policy:
    """Return the policies of a run's trainings as they are now, their leaves [R, ...]."""
    state = progress.state
    assert state is not None
    here = jax.local_devices()[0]
    params, normalizer = jax.device_put((state.learner.params, state.normalizer), here)
    return Policy(config.agents.bind(state.spec), params, normalizer)


def own_code(config: RunConfig) -> list[OwnCode]:
    """Return the callbacks that a run's settings name, checked before anything is compiled.

    Raises:
      UsageError: a class is not there, or is no callback; two share a metric's name; or nobody
        here trusts a file.
    """
    made = (_made(name) for name in config.callbacks or ())
    found = check_callbacks(made, config.stop_at_return)
    return [OwnCode(callback, config) for callback in found]


def has_reached(run_dir: Path, config: RunConfig) -> bool:
    """Return whether a run has saved what its `stop_at_return` asks for, where it asks."""
    if config.stop_at_return is None:
        return False
    try:
        known = read_metrics(run_dir, len(config.trainings))
    except UsageError:  # whoever goes on with a damaged table is told there
        return False
    saved = max(saved_iterations(run_dir), default=0)
    reports = np.flatnonzero(known["iteration"][0] == saved) if known else ()
    return len(reports) > 0 and StopAtReturn(config.stop_at_return).reached(
        {name: x[:, reports[-1]] for name, x in known.items()}
    )


def _made(name: str) -> tuple[Any, str]:
    """Return a callback that is not checked yet, and its name in a sentence."""
    kind, label = plugins.load_class(name), f"callbacks: {plugins.label(name)}"
    needed = [
        x.name
        for x in inspect.signature(kind).parameters.values()
        if x.default is x.empty and x.kind not in (x.VAR_POSITIONAL, x.VAR_KEYWORD)
    ]
    if needed:
        raise UsageError(f"{label} is made without arguments, and asks for {', '.join(needed)}.")
    return kind(), label
