"""`load`: a trained policy from a run's folder."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax.agents import Agent
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.normalization import normalize
from hitmdp_jax.training.checkpoint import Checkpoints
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.program import TrainState, make_train


@dataclasses.dataclass(frozen=True)
class Policy:
    """A trained policy with its observation normaliser; pure, so that it jits and vmaps.

    >>> policy = load("runs/halfcheetah/mopg/...")  # doctest: +SKIP
    >>> memory = policy.initial_memory(key)  # doctest: +SKIP
    >>> action, memory = policy.act(obs, memory, key)  # doctest: +SKIP
    """

    agent: Agent
    params: Any
    normalizer: Any

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> Any:
        """Return the memory of an episode's start."""
        return self.agent.initial_memory(key, batch_shape)

    def act(
        self, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any]:
        """Return actions [..., A] for raw observations [..., O], and the new memory."""
        obs = normalize(jnp.asarray(obs, jnp.float32), self.normalizer)
        action, memory, _ = self.agent.act(self.params, obs, memory, key, deterministic)
        return action, memory


def load(run_dir: str | Path, seed: int = 0) -> Policy:
    """Load a policy from the newest checkpoint of a run.

    Args:
      run_dir: the run's folder.
      seed: which of the run's seeds, by the number the run gave it.

    Raises:
      UsageError: the folder holds no run, no checkpoint, or no such seed.
    """
    run_dir = Path(run_dir)
    config = RunConfig.load(run_dir)
    seeds = range(config.seed, config.seed + config.seeds)
    if seed not in seeds:
        raise UsageError(
            f"seed = {seed} is not in the run '{run_dir}', which holds {seeds.start} to "
            f"{seeds.stop - 1}."
        )
    agent = config.make_agent()
    checkpoints = Checkpoints(run_dir)
    try:
        everyone = checkpoints.restore_policy(abstract_state(config, agent, config.env))
    finally:
        checkpoints.close()
    return Policy(agent, *jax.tree.map(lambda x: x[seed - config.seed], everyone))


def restore(run_dir: Path, config: RunConfig, agent: Agent) -> tuple[int, TrainState]:
    """Return the iteration and the state [S, ...] of a run's newest checkpoint."""
    checkpoints = Checkpoints(run_dir)
    try:
        number = min((checkpoints.latest() - 1) // config.iterations, len(config.tasks) - 1)
        return checkpoints.restore(abstract_state(config, agent, config.tasks[number]))
    finally:
        checkpoints.close()


def abstract_state(config: RunConfig, agent: Agent, task: dict[str, Any]) -> TrainState:
    """Return the shapes and types of a run's state [S, ...] while it trains on a task."""
    env = make_env(**task, physics=config.physics)
    init, _ = make_train(
        agent,
        env,
        num_steps=config.total_steps,
        num_envs=config.num_envs,
        rollout_length=config.rollout_length,
    )
    keys = jax.eval_shape(jax.vmap(jax.random.key), jnp.zeros(config.seeds, jnp.uint32))
    return jax.eval_shape(jax.vmap(init), keys)
