"""Scoring a trained policy: whole episodes, in any engine, Gymnasium itself among them."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env

from hitmdp_jax.envs import check_env, make_env
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name
from hitmdp_jax.learning.rollout import observation_of
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.policy import Policy

ENGINES = ("native", "mjx", "warp", "gymnasium")


@dataclasses.dataclass(frozen=True)
class Scores:
    """Undiscounted returns and lengths of whole episodes, one entry an episode."""

    returns: np.ndarray  # [N]
    lengths: np.ndarray  # [N] control steps

    @property
    def standard_error(self) -> float:
        """Standard error of the mean return."""
        return float(self.returns.std(ddof=1) / np.sqrt(len(self.returns)))


def score(
    policy: Policy,
    config: RunConfig,
    engine: str,
    episodes: int,
    key: jax.Array,
    deterministic: bool = False,
) -> Scores:
    """Run a policy for some episodes of its own task.

    Args:
      policy: what acts.
      config: the settings of the run it comes from.
      engine: "native", "mjx", "warp" or "gymnasium".
      episodes: how many, all side by side.
      key: PRNG key of the initial states and the actions.
      deterministic: take the likeliest option and action instead of sampling.

    Raises:
      UsageError: the engine is unknown or does not have the task, or episodes < 1.
    """
    if engine not in ENGINES:
        raise unknown_name("engine", engine, ENGINES)
    if episodes < 1:
        raise out_of_domain("episodes", episodes, "a positive whole number")
    if engine == "gymnasium":
        return score_in_gymnasium(policy, config.tasks[-1], episodes, key, deterministic)
    return score_in_jax(
        policy, make_env(**config.tasks[-1], physics=engine), episodes, key, deterministic
    )


def score_in_jax(
    policy: Policy, env: Env, episodes: int, key: jax.Array, deterministic: bool = False
) -> Scores:
    """Run each of N environments until its first episode ends. Pure but for the final copy."""
    vector_env = VectorEnv(env, episodes, pool_size=1, stagger=False)
    key_reset, key_memory, key_steps = jax.random.split(key, 3)

    def step(carry: Any, key: jax.Array):
        state, memory, scored, total, length = carry
        action, memory = policy.act(observation_of(state), memory, key, deterministic)
        state, outcome = vector_env.step(state, action)
        total = jnp.where(scored, total, outcome.episode_return)
        length = jnp.where(scored, length, outcome.episode_length)
        return (state, memory, scored | outcome.finished, total, length), None

    @jax.jit
    def run(key_reset: jax.Array, key_memory: jax.Array, keys: jax.Array):
        start = (
            vector_env.reset(key_reset),
            policy.initial_memory(key_memory, (episodes,)),
            jnp.zeros(episodes, bool),
            jnp.zeros(episodes),
            jnp.zeros(episodes, jnp.int32),
        )
        (_, _, _, total, length), _ = jax.lax.scan(step, start, keys)
        return total, length

    keys = jax.random.split(key_steps, vector_env.episode_length)
    total, length = run(key_reset, key_memory, keys)
    return Scores(np.asarray(total), np.asarray(length))


def score_in_gymnasium(
    policy: Policy,
    task: dict[str, Any],
    episodes: int,
    key: jax.Array,
    deterministic: bool = False,
) -> Scores:
    """Run the policy in Gymnasium's own environment, in Gymnasium's own loop.

    Args:
      policy: what acts.
      task: name, version and keywords, as in a run's settings.
      episodes: how many.
      key: PRNG key; it seeds Gymnasium too.
      deterministic: take the likeliest option and action instead of sampling.

    Raises:
      UsageError: Gymnasium has no such task.
    """
    import gymnasium

    keywords = dict(task)
    name, version = keywords.pop("name"), keywords.pop("version", "v5")
    class_name = check_env(name, version).__name__
    if f"{class_name}-{version}" not in gymnasium.registry:
        raise UsageError(f"Gymnasium has no environment '{name}'; use --engine native or mjx.")
    if version == "v4":
        keywords = {}  # v4 constructors do not take every keyword of v5
    envs = [gymnasium.make(f"{class_name}-{version}", **keywords) for _ in range(episodes)]
    key_memory, key_seed, key = jax.random.split(key, 3)
    first_seed = int(jax.random.randint(key_seed, (), 0, 2**30))
    obs = np.stack([env.reset(seed=first_seed + i)[0] for i, env in enumerate(envs)])
    memory = policy.initial_memory(key_memory, (episodes,))
    act = jax.jit(lambda obs, memory, key: policy.act(obs, memory, key, deterministic))

    returns, lengths = np.zeros(episodes), np.zeros(episodes, int)
    running = set(range(episodes))
    while running:
        key, key_act = jax.random.split(key)
        action, memory = act(obs.astype(np.float32), memory, key_act)
        action = np.asarray(action)
        for i in sorted(running):
            box: Any = envs[i].action_space
            obs[i], reward, terminated, truncated, _ = envs[i].step(
                np.clip(action[i], box.low, box.high)
            )
            returns[i] += float(reward)
            lengths[i] += 1
            if terminated or truncated:
                running.remove(i)
    return Scores(returns, lengths)
