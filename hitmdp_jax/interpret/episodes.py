"""Whole episodes of a policy, step by step: what figures, videos and studies read."""

import functools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env, State
from flax import struct

from hitmdp_jax.envs import check_env
from hitmdp_jax.envs.action_repeat import action_repeat_of, steps_taken
from hitmdp_jax.envs.drawing import draws_itself, model_of
from hitmdp_jax.envs.numbers import with_numbers
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.precision import as_before, in_32_bits
from hitmdp_jax.training.policy import Policy

STATIC = ("env", "num_episodes", "deterministic", "physics", "pictured")
COORDINATES = ("qpos", "qvel", "ctrl")
OURS_ALONE = {
    "hide_velocities": False,
    "action_repeat": 1,
    "friction_range": (1.0, 1.0),
    "mass_range": (1.0, 1.0),
}  # keywords that Gymnasium lacks, and where it agrees


class Trajectories(struct.PyTreeNode):
    """N whole episodes side by side, T steps long: as long as the time limit or the longest.

    A step holds what the policy saw and what it did there. Steps after an episode's end are
    padding, as `alive` says; their reward is 0, the rest of them means nothing. Of many policies at
    once, every field has their axis in front.
    """

    obs: jax.Array  # [T, N, O] as the task gives them, not normalised
    action: jax.Array  # [T, N, A] as carried out, within the task's range
    reward: jax.Array  # [T, N]
    option: jax.Array | None  # [T, N] int, o_t; None of a policy without options
    # [T, N, K] P(o_t | s_t, what the policy remembers); None also of options that were given.
    option_probs: jax.Array | None
    alive: jax.Array  # [T, N] bool, the step belongs to the episode
    control_steps: jax.Array  # [T, N] int, as many as the action was held for; 0 where not alive
    terminated: jax.Array  # [N] bool, the task ended the episode
    success: jax.Array | None = None  # [N] 1 where it reached its goal, None of tasks without one
    # The state that `obs` shows, None unless asked for: m, rad and their rates; `ctrl` is that of
    # the step before.
    qpos: jax.Array | None = None  # [T, N, nq]
    qvel: jax.Array | None = None  # [T, N, nv]
    ctrl: jax.Array | None = None  # [T, N, nu]
    state: Any = None  # [T, N, ...] likewise the whole state of a task that draws itself

    def episode(self, n: int) -> "Trajectories":
        """Return episode n alone, [T, 1, ...]; its fields for pictures may be of fewer episodes."""
        ends = {"terminated": self.terminated, "success": self.success}
        steps = self.replace(terminated=None, success=None)
        alone = jax.tree.map(lambda x: x[:, n : n + 1], steps)
        return alone.replace(**jax.tree.map(lambda x: x[n : n + 1], ends))

    @property
    def truncated(self) -> jax.Array:
        """Whether the time limit ended the episode, [N]."""
        return ~self.terminated

    @property
    def returns(self) -> jax.Array:
        """Undiscounted returns [N]."""
        return self.reward.sum(axis=-2)

    @property
    def lengths(self) -> jax.Array:
        """Lengths [N] in control steps: one an action, unless the task holds them."""
        return self.control_steps.sum(axis=-2)


@functools.partial(jax.jit, static_argnames=STATIC)
def run_episodes(
    policy: Policy,
    env: Env,
    key: jax.Array,
    num_episodes: int,
    *,
    options: jax.Array | None = None,
    deterministic: bool = False,
    physics: bool = False,
    pictured: int | None = None,
    numbers: Mapping[str, jax.Array] | None = None,
) -> Trajectories:
    """Run a policy in N environments, each until its first episode ends.

    Compiled once for an environment, whichever policy of one kind follows; it may be vmapped over
    policies.

    Args:
      policy: what acts.
      env: the task, unbatched and without auto-reset.
      key: PRNG key of the initial states and the actions.
      num_episodes: N.
      options: [T, N] int, those to follow instead of the policy's own choices. Actions are drawn
        from its P(a | s, o) by the same keys: under its own choices it repeats its own episode.
      deterministic: take the likeliest option and action instead of sampling.
      physics: record what pictures need too: the generalised coordinates and controls, or the
        whole states of a task that draws itself.
      pictured: of how many episodes, the first ones, what pictures need is recorded; None: of all.
      numbers: other numbers [] of the task's, by keyword (`envs.numbers`).

    Raises:
      UsageError: `physics` is asked for where a task has no MuJoCo state and does not draw itself.
    """
    env = with_numbers(env, numbers) if numbers else env
    key_reset, key_memory, key_steps = jax.random.split(key, 3)
    start = (
        jax.vmap(env.reset)(jax.random.split(key_reset, num_episodes)),
        in_32_bits(policy.initial_memory(key_memory, (num_episodes,))),
        jnp.ones(num_episodes, bool),
    )
    keys = jax.random.split(key_steps, most_actions(env))
    shown = slice(pictured if physics else 0)
    step = functools.partial(_step, policy, env, deterministic, shown)
    (_, _, alive), steps = jax.lax.scan(step, start, (keys, options))
    success = jax.tree.map(lambda x: x.max(axis=0), steps.pop("success"))
    return in_32_bits(Trajectories(**steps, terminated=~alive, success=success))


def _step(
    policy: Policy,
    env: Env,
    deterministic: bool,
    pictured: slice,
    before: tuple[Any, Any, jax.Array],
    now: tuple[jax.Array, jax.Array | None],
) -> tuple[tuple[Any, Any, jax.Array], dict[str, Any]]:
    """Take one step of all episodes; return what it leaves behind, and what is recorded of it.

    Args:
      policy: what acts.
      env: the task.
      deterministic: as of `run_episodes`.
      pictured: the episodes of which what pictures need is recorded, too.
      before: state [N, ...], the policy's memory [N, ...], and whether the episode goes on [N].
      now: key of the step; options [N] to follow, None for the policy's own.
    """
    (state, memory, alive), (key, option) = before, now
    if option is None:
        decision, memory = _decide(policy, state.obs, memory, key, deterministic)
    else:
        decision = _follow(policy, state.obs, option, key, deterministic)
    new_state = as_before(jax.vmap(env.step)(state, decision["action"]), state)
    shown = {}
    if pictured.stop != 0:
        shown = _pictured(env, jax.tree.map(lambda x: x[pictured], state))
    seen = decision | shown | _outcome(policy, state, new_state, alive)
    return (new_state, memory, alive & ~new_state.done.astype(bool)), seen


def most_actions(env: Env) -> int:
    """Return how many actions a task's time limit lets an episode have."""
    return -(-spec_of(env).episode_length // action_repeat_of(env))


def run_in_gymnasium(
    policy: Policy,
    task: dict[str, Any],
    key: jax.Array,
    num_episodes: int,
    *,
    deterministic: bool = False,
    physics: bool = False,
) -> Trajectories:
    """Run the policy in Gymnasium's own environments, in Gymnasium's own loop.

    Args:
      policy: what acts.
      task: name, version and keywords, as in a run's settings.
      key: PRNG key; it seeds Gymnasium too.
      num_episodes: N.
      deterministic: take the likeliest option and action instead of sampling.
      physics: record the generalised coordinates and controls too.

    Raises:
      UsageError: Gymnasium has no such task.
    """
    envs = _gymnasium_envs(task, num_episodes)
    key_memory, key_seed, key = jax.random.split(key, 3)
    first_seed = int(jax.random.randint(key_seed, (), 0, 2**30))
    obs = np.stack([env.reset(seed=first_seed + i)[0] for i, env in enumerate(envs)])
    memory = policy.initial_memory(key_memory, (num_episodes,))
    alive, terminated = np.ones(num_episodes, bool), np.zeros(num_episodes, bool)
    steps = []
    while alive.any():
        key, key_act = jax.random.split(key)
        decision, memory = _decide(policy, obs.astype(np.float32), memory, key_act, deterministic)
        seen: dict[str, Any] = {"obs": obs.copy(), "alive": alive.copy()}
        seen["control_steps"] = alive.astype(np.int32)
        if physics:
            data = [env.unwrapped.data for env in envs]
            seen |= {name: np.stack([getattr(d, name) for d in data]) for name in COORDINATES}
        action, reward = np.asarray(decision["action"]), np.zeros(num_episodes)
        for i in np.flatnonzero(alive):
            obs[i], reward[i], terminated[i], truncated, _ = envs[i].step(action[i])
            alive[i] = not (terminated[i] or truncated)
        steps.append(decision | seen | {"reward": reward})
    for env in envs:
        env.close()
    recorded = jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *steps)
    return Trajectories(**recorded, terminated=jnp.asarray(terminated))


@functools.partial(jax.jit, static_argnames="deterministic")
def _decide(
    policy: Policy, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool
) -> tuple[dict[str, Any], Any]:
    """Return a policy's decisions for raw observations [N, O], and its new memory."""
    decided = policy.decide(policy.flat(obs), memory, key, deterministic)
    decision = {
        "action": decided.action,
        "option": decided.option,
        "option_probs": policy.option_probs(obs, memory),
    }
    return in_32_bits((decision, decided.memory))


def _follow(
    policy: Policy, obs: jax.Array, option: jax.Array, key: jax.Array, deterministic: bool
) -> dict[str, Any]:
    """Return a policy's decisions for raw observations [N, O] under given options [N]."""
    _, key_action = jax.random.split(key)  # as every agent with options splits it
    chosen = policy.agent.policy(policy.params, policy.normalized(obs), option)
    action = chosen.mode() if deterministic else chosen.sample(seed=key_action)
    action = policy.spec.action.clip(action)
    return in_32_bits({"action": action, "option": option, "option_probs": None})


def _outcome(policy: Policy, state: State, new_state: State, alive: jax.Array) -> dict[str, Any]:
    """Return the record of a step, with zeros in episodes [N] that have ended."""
    reached = new_state.metrics.get("success")  # so far; None of tasks without a goal
    several = isinstance(state.obs, Mapping)
    return {
        "obs": policy.spec.observation.flat(state.obs) if several else state.obs,
        "reward": jnp.where(alive, new_state.reward, 0.0),
        "alive": alive,
        "control_steps": jnp.where(alive, steps_taken(state, new_state), 0),
        "success": None if reached is None else jnp.where(alive, reached, 0.0),
    }


def _pictured(env: Env, state: State) -> dict[str, Any]:
    """Return the parts of a state that pictures are made from."""
    if draws_itself(env):
        return {"state": state}
    if model_of(env) is None:
        raise UsageError("This task has no MuJoCo state to record; use physics=False.")
    data = getattr(state, "data", None)  # Playground's word
    data = state.pipeline_state if data is None else data
    return {name: getattr(data, name) for name in COORDINATES}


def _gymnasium_envs(task: dict[str, Any], number: int) -> list[Any]:
    import gymnasium

    keywords = dict(task)
    name, version = keywords.pop("name"), keywords.pop("version", "v5")
    constructor = check_env(name, version)
    for keyword, default in OURS_ALONE.items():
        value = keywords.pop(keyword, default)
        if (tuple(value) if isinstance(value, list) else value) != default:
            raise UsageError(f"Gymnasium has no {keyword}; use --engine native or mjx.")
    # By where it is defined: a class of someone's own may be called Ant, too.
    if not constructor.__module__.startswith("hitmdp_jax.envs.suites.gym."):
        raise UsageError(f"Gymnasium has no environment '{name}'; use --engine native or mjx.")
    if version == "v4":
        keywords = {}  # v4 constructors do not take every keyword of v5
    registered = f"{constructor.__name__}-{version}"
    return [gymnasium.make(registered, **keywords) for _ in range(number)]
