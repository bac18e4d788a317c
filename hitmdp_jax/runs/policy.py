"""A trained policy, and `load`, which takes it out of a run's folder."""

import contextlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.training.acme.running_statistics import NestedMeanStd
from flax import struct
from jax.typing import ArrayLike

from hitmdp_jax.agents import Agent
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError, out_of_domain
from hitmdp_jax.learning.normalization import normalize
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import is_policy
from hitmdp_jax.runs.policy_file import read_policy
from hitmdp_jax.training.sweep import Training

Observed = ArrayLike | Mapping[str, ArrayLike]  # as the task shows it, one array or several by name


class Policy(struct.PyTreeNode):
    """A trained policy with its observation normaliser: a pytree of pure functions.

    >>> policy = load("runs/halfcheetah/mopg/...")  # doctest: +SKIP
    >>> memory = policy.initial_memory(key)  # doctest: +SKIP
    >>> action, memory = policy.act(obs, memory, key)  # doctest: +SKIP
    """

    agent: Agent  # bound to the task that it learned
    params: Any
    normalizer: Any

    @property
    def spec(self) -> Spec:
        """What the policy observes and how it acts."""
        return self.agent.task

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start."""
        return self.agent.initial_memory(key, batch_shape)

    def act(
        self, obs: Observed, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any]:
        """Return actions for raw observations, as the task gives them, and the new memory.

        Raises:
          UsageError: the observation has another size than those the policy learned from.
        """
        obs = self.normalized(obs)
        action, memory, _ = self.agent.act(self.params, obs, memory, key, deterministic)
        return action, memory

    def option_probs(self, obs: Observed, memory: Any) -> jax.Array | None:
        """Return P(o_t | s_t, what is remembered) [..., K] for raw observations; Raises as `act`.

        None of a policy without options.
        """
        return self.agent.option_probs(self.params, self.normalized(obs), memory)

    def value(self, obs: Observed, memory: Any) -> jax.Array | None:
        """Return the expected discounted return [...] from raw observations; Raises as `act`.

        It is of scaled rewards where `reward_scale` is not 1, and None of an algorithm that does
        not say.
        """
        return self.agent.value_of(self.params, self.normalized(obs), memory)

    def of(self, places: ArrayLike) -> "Policy":
        """Return the policy of one training, or of some, by their places among leaves [R, ...]."""
        return jax.tree.map(lambda x: x[places] if np.ndim(x) else x, self)

    def normalized(self, obs: Observed) -> jax.Array:
        """Return raw observations as the agent sees them, rows [..., O]; Raises as `act`."""
        seen = self.spec.observation
        if isinstance(obs, Mapping):
            for part, shape in seen.parts:
                if part not in obs:
                    raise UsageError(f"obs lacks its part '{part}'.")
                _check_shape(f"obs['{part}']", obs[part], shape)
        else:
            _check_shape("obs", obs, seen.shape)
        statistics = self.normalizer if self.agent.normalize_observations else None
        return normalize(seen.flat(obs), statistics)


def _check_shape(name: str, x: ArrayLike, shape: tuple[int, ...]) -> None:
    """Raise UsageError where an array's last axes are not of that shape."""
    if np.shape(x)[np.ndim(x) - len(shape) :] != shape:
        raise UsageError(f"{name} has shape {np.shape(x)}; its last axes must be {shape}.")


def load(
    run_dir: str | Path,
    seed: int | None = None,
    checkpoint: int | str = "newest",
    setting: int = 0,
    task: int | None = None,
    trust: bool = False,
) -> Policy:
    """Load a policy of a run.

    Args:
      run_dir: the run's folder.
      seed: which of the run's seeds, by the number the run gave it; None takes the first.
      checkpoint: "newest"; "best", by the training return; or an iteration that was saved.
      setting: which setting of a sweep, by the number that its tables give it.
      task: of a transfer, the task whose newest or best checkpoint is asked for: 0 or 1. None takes
        the one that the newest checkpoint is of.
      trust: run the file of an own task or algorithm that the run names. It needs no such word
        where `save` or a command line of this user has named the file.

    Raises:
      UsageError: the folder holds no run, or no such checkpoint, seed or setting; or the run names
        a file that nobody here trusts.
    """
    run_dir = folder_of(run_dir)
    config = RunConfig.load(run_dir, trust)
    (place, *_) = places(config.trainings, config.seed if seed is None else seed, setting)
    _, everyone = load_all(run_dir, checkpoint, task)
    return everyone.of(place)


def places(
    trainings: Sequence[Training], seed: int | None = None, setting: int | None = None
) -> list[int]:
    """Return the places of those of a run's trainings of a seed and a setting; None takes all.

    Raises:
      UsageError: the run has no such seed or setting.
    """
    seeds, settings = ({getattr(t, name) for t in trainings} for name in ("seed", "setting"))
    for name, wanted, there in (("seed", seed, seeds), ("setting", setting, settings)):
        if wanted is not None and (not isinstance(wanted, int) or wanted not in there):
            raise UsageError(
                f"{name} = {wanted} is not in the run, which holds {min(there)} to {max(there)}."
            )
    return [
        i
        for i, training in enumerate(trainings)
        if seed in (None, training.seed) and setting in (None, training.setting)
    ]


def load_all(
    run_dir: str | Path, checkpoint: int | str = "newest", task: int | None = None
) -> tuple[int, Policy]:
    """Return a checkpoint's iteration and the policies of all trainings, their leaves [R, ...].

    Args and Raises as `load`.
    """
    run_dir = folder_of(run_dir)
    config = RunConfig.load(run_dir)
    if is_policy(run_dir):
        _, iteration, saved, spec = read_policy(run_dir)
        if checkpoint not in ("newest", "best", iteration):
            raise UsageError(f"'{run_dir}' holds no checkpoint {checkpoint}; it holds {iteration}.")
    else:
        with contextlib.closing(Checkpoints(run_dir, read_only=True)) as checkpoints:
            iteration, saved, spec = checkpoints.restore_policy(checkpoint, task)
    agents = config.make_agent().replace(**config.swept).bind(spec)
    policy = acting(agents, saved)
    if not fits(policy, len(config.trainings)):
        raise UsageError(
            f"The checkpoint in '{run_dir}' does not fit the algorithm and seeds that its "
            "config.yaml names."
        )
    return iteration, policy


def acting(agent: Agent, saved: dict[str, Any]) -> Policy:
    """Return the policy of an agent, bound to its task, and of what a checkpoint keeps of it."""
    return Policy(agent, saved["params"], NestedMeanStd(mean=saved["mean"], std=saved["std"]))


def folder_of(run_dir: Any) -> Path:
    """Return a folder's path, or raise UsageError where there is none."""
    if not isinstance(run_dir, str | os.PathLike) or not str(run_dir):
        raise out_of_domain("run_dir", repr(run_dir), "the path of a run's folder")
    return Path(run_dir)


def fits(policy: Policy, trainings: int) -> bool:
    """Return whether the parameters [S, ...] are such as the agent makes; they may be anything."""

    def same_shapes(policy: Policy, key: jax.Array) -> bool:
        one = policy.of(0)
        one.act(jnp.zeros(one.spec.observation.shape), one.initial_memory(key), key)
        fresh = one.agent.init(key, one.spec).params
        shapes = [jax.tree.map(jnp.shape, tree) for tree in (one.params, fresh)]
        return shapes[0] == shapes[1]

    fits: list[bool] = []
    # Acting on parameters of another kind fails in as many ways as there are kinds.
    with contextlib.suppress(Exception):
        jax.eval_shape(lambda *args: fits.append(same_shapes(*args)), policy, jax.random.key(0))
    return fits == [True] and len(policy.normalizer.mean) == trainings
