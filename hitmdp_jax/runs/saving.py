"""`save` and `extract`: a trained policy into a folder, or a file, that `load` reads."""

import dataclasses
import inspect
from pathlib import Path
from typing import Any

import jax
import numpy as np

from hitmdp_jax import plugins
from hitmdp_jax.agents import AGENTS, Agent
from hitmdp_jax.agents.base import check_hyperparameters, hyperparameters_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.checkpoint_items import Progress, kept_of, policy_of
from hitmdp_jax.runs.claim import claim
from hitmdp_jax.runs.config import RunConfig, trust_named
from hitmdp_jax.runs.folder import POLICY
from hitmdp_jax.runs.policy import acting, fits, folder_of, load_all, places
from hitmdp_jax.runs.policy_file import write_policy
from hitmdp_jax.training.state import TrainState
from hitmdp_jax.training.sweep import apart


def save(run_dir: str | Path, agent: Agent, state: TrainState, *, overwrite: bool = False) -> None:
    """Save what the library trained, for `load`: the agent, and a state [...] or [S, ...].

    Args:
      run_dir: a folder, made if need be.
      agent: the algorithm that was trained.
      state: what `train` or a step returned, of one seed or vmapped over seeds.
      overwrite: replace a run that the folder holds.

    Raises:
      UsageError: the folder holds a run or cannot be written, the agent's class has no file, or the
        state is of another agent.
    """
    folder = folder_of(run_dir)
    check_hyperparameters(agent)
    if not isinstance(state, TrainState):
        raise UsageError(f"state is a {type(state).__name__}; pass the TrainState of a training.")
    if state.iteration.ndim == 0:
        state = _of_one_seed(state)
    seeds = len(state.iteration)
    config = RunConfig(algo=describe(agent), seeds=seeds)
    if not fits(acting(agent.bind(state.spec), policy_of(state)), seeds):
        raise UsageError(f"The state does not fit the agent: {type(agent).__name__} made another.")
    run_dir = claim(folder, config, overwrite)
    trust_named(config.to_dict(), remember=True)
    checkpoints = Checkpoints(run_dir)
    checkpoints.save(Progress(int(np.max(state.iteration)), 0, state))
    checkpoints.close()
    if checkpoints.failure:
        raise UsageError(f"'{run_dir}' cannot be written: {checkpoints.failure}")


@jax.jit  # else one program for each shape
def _of_one_seed(state: TrainState) -> TrainState:
    return jax.tree.map(lambda x: x[None], state)


def extract(
    run_dir: str | Path,
    path: str | Path,
    seed: int | None = None,
    checkpoint: int | str = "newest",
    setting: int = 0,
    task: int | None = None,
    trust: bool = False,
) -> None:
    """Copy one policy of a run into a file of its own, which `load` reads: a few hundred kB.

    It holds the settings, as of a run of that seed alone, and nothing to train on from.

    Args:
      run_dir: the run's folder.
      path: the file, whose name ends with `.policy`; it replaces what is there.
      seed: as `load`.
      checkpoint: as `load`.
      setting: as `load`.
      task: as `load`.
      trust: as `load`.

    Raises:
      UsageError: as `load`, or the file has another name.
      OSError: the file cannot be written.
    """
    if Path(path).suffix != POLICY:
        raise UsageError(f"'{path}' must end with {POLICY}, by which `load` knows such a file.")
    config = RunConfig.load(folder_of(run_dir), trust)
    (place, *_) = places(config.trainings, config.seed if seed is None else seed, setting)
    iteration, everyone = load_all(run_dir, checkpoint, task)
    training = config.trainings[place]
    of_agent, of_task = apart(training.swept)
    alone = {"seeds": 1, "seed": training.seed, "sweep": None, "samples": None}
    if of_task:
        alone["env"] = (config.env or {}) | of_task
    own = dataclasses.replace(config, algo=config.algo | of_agent, **alone)
    learned = kept_of(everyone.params, everyone.normalizer)
    mine = jax.tree.map(lambda x: x[place : place + 1], learned)
    write_policy(Path(path), own.to_yaml(), iteration, mine, everyone.spec)


def describe(agent: Agent) -> dict[str, Any]:
    """Return an agent as a run's settings name it: by its algorithm and hyperparameters.

    Raises:
      UsageError: its class is defined in no file, or a hyperparameter is not one number.
    """
    kind = type(agent)
    names = [name for name, known in AGENTS.items() if known is kind]
    file = inspect.getsourcefile(kind) if not names and kind.__module__ != "__main__" else None
    if not names and file is None:
        raise UsageError(f"{kind.__name__} must be defined in a file of its own to be saved.")
    name = names[0] if names else plugins.absolute(f"{file}:{kind.__name__}")
    settings: dict[str, Any] = {"name": name}
    for field in hyperparameters_of(agent):
        value = getattr(agent, field.name)
        if isinstance(value, jax.Array | np.ndarray | np.generic):
            if np.size(value) != 1:
                raise UsageError(
                    f"{field.name} has {np.size(value)} values: save the runs of a sweep apart."
                )
            value = float(np.asarray(value).reshape(()))
        settings[field.name] = list(value) if isinstance(value, tuple) else value
    return settings
