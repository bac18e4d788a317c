"""Environment steps per second of other libraries' suites, in our loop and in their own.

`python benchmarks/suites_speed.py` prints a table. `ours` is `VectorEnv` as training has it: it
draws a pool of fresh states once a rollout, and restarts from it. `own` is what the library itself
offers, under `jax.vmap`: gymnax and Craftax draw a fresh state at every step and take it where an
episode has ended, XLand-MiniGrid's `GymAutoResetWrapper` does likewise, and Playground's wrappers
go back to the state in which the environment first began. Both take the same random actions, inside
one compiled scan. They take turns, and the table shows each one's median turn.
"""

import argparse
import functools
import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

import hitmdp_jax
from hitmdp_jax.envs.spec import Action, Discrete
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.training.sizes import usual_pool_size

ROLLOUT = 128  # steps
TASKS = (
    "gymnax/CartPole-v1",
    "gymnax/FourRooms-misc",
    "gymnax/Breakout-MinAtar",
    "xminigrid/MiniGrid-DoorKey-8x8",
    "craftax/Craftax-Classic-Symbolic-v1",
    "playground/CheetahRun",
)


class Loop(NamedTuple):
    """How environments [B] are started and stepped."""

    start: Callable[[jax.Array], Any]  # key -> state
    # (state, actions, key) -> state, and what a rollout would keep
    step: Callable[[Any, jax.Array, jax.Array], tuple[Any, Any]]
    refresh: Callable[[Any, jax.Array], Any] = lambda state, key: state  # once a rollout


def ours(env: Any, num_envs: int) -> Loop:
    """Return the loop of this package."""
    vector = VectorEnv(env, num_envs, usual_pool_size(num_envs, ROLLOUT))

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        state, seen = vector.step(state, action)
        return state, (seen.reward, seen.terminated | seen.truncated, vector.observation(state))

    return Loop(vector.reset, step, vector.refill)


def keyed(env: Any, num_envs: int) -> Loop:
    """Return the loop of a library of gymnax's interface: gymnax itself, and Craftax."""
    task, params = env.task, env.params
    if not hasattr(task, "reset_env"):
        raise TypeError(f"{task} has not gymnax's interface.")

    def start(key: jax.Array) -> Any:
        return jax.vmap(task.reset, (0, None))(jax.random.split(key, num_envs), params)[1]

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        each = jax.vmap(task.step, (0, 0, 0, None))
        out = each(jax.random.split(key, num_envs), state, action, params)
        return out[1], (out[2], out[3], out[0])

    return Loop(start, step)


def craftax(env: Any, num_envs: int) -> Loop:
    """Return Craftax's loop, in its own auto-reset and with its own time limit."""
    from craftax.craftax_env import make_craftax_env_from_name

    task: Any = make_craftax_env_from_name("Craftax-Classic-Symbolic-v1", auto_reset=True)
    own = type("Own", (), {"task": task, "params": task.default_params})
    return keyed(own, num_envs)


def xminigrid(env: Any, num_envs: int) -> Loop:
    """Return XLand-MiniGrid's loop."""
    from xminigrid.wrappers import GymAutoResetWrapper

    task, params = GymAutoResetWrapper(env.task), env.params

    def start(key: jax.Array) -> Any:
        return jax.vmap(functools.partial(task.reset, params))(jax.random.split(key, num_envs))

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        state = jax.vmap(functools.partial(task.step, params))(state, action)
        return state, (state.reward, state.last(), state.observation)

    return Loop(start, step)


def playground(env: Any, num_envs: int) -> Loop:
    """Return Playground's loop, in the wrappers of its own training."""
    from mujoco_playground import wrapper

    task = wrapper.wrap_for_brax_training(env.task, env.spec.episode_length)

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        state = task.step(state, action)
        return state, (state.reward, state.done, state.obs)

    return Loop(lambda key: task.reset(jax.random.split(key, num_envs)), step)


OWN = {"gymnax": keyed, "xminigrid": xminigrid, "craftax": craftax, "playground": playground}


def random_actions(action: Action, key: jax.Array, num_envs: int) -> jax.Array:
    """Draw actions [B] or [B, A]."""
    if isinstance(action, Discrete):
        return jax.random.randint(key, (num_envs,), 0, action.n)
    low, high = (jnp.asarray(x, jnp.float32) for x in (action.low, action.high))
    return jax.random.uniform(key, (num_envs, action.size), minval=low, maxval=high)


def rollouts(loop: Loop, action: Action, num_envs: int) -> Callable[[], None]:
    """Compile a loop, and return what goes on by one rollout and waits for it."""

    @jax.jit
    def rollout(state: Any, key: jax.Array) -> tuple[Any, Any]:
        def step(state: Any, key: jax.Array) -> tuple[Any, Any]:
            key_action, key_step = jax.random.split(key)
            return loop.step(state, random_actions(action, key_action, num_envs), key_step)

        key_refresh, key_steps = jax.random.split(key)
        state = loop.refresh(state, key_refresh)
        return jax.lax.scan(step, state, jax.random.split(key_steps, ROLLOUT))

    keys = iter(jax.random.split(jax.random.key(1), 100_000))
    state = jax.jit(loop.start)(jax.random.key(0))

    def go_on() -> None:
        nonlocal state
        state, kept = rollout(state, next(keys))
        jax.block_until_ready(kept)

    go_on()
    return go_on


def seconds_of(call: Callable[[], None]) -> float:
    """Return how long a call takes."""
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", default=TASKS)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--turns", type=int, default=9)
    arguments = parser.parse_args()
    num_envs = arguments.num_envs
    print(f"| task, {num_envs} environments | ours | own | ratio |\n| --- | --- | --- | --- |")
    for name in arguments.tasks:
        env: Any = hitmdp_jax.make_env(name)
        own = OWN[name.split("/")[0]]
        calls = [rollouts(x(env, num_envs), env.spec.action, num_envs) for x in (ours, own)]
        turns = [[seconds_of(call) for call in calls] for _ in range(arguments.turns)]
        mine, theirs = (ROLLOUT * num_envs / statistics.median(x) for x in zip(*turns, strict=True))
        ratio = statistics.median(b / a for a, b in turns)
        print(f"| `{name}` | {mine:,.0f} | {theirs:,.0f} | {ratio:.2f} |", flush=True)


if __name__ == "__main__":
    main()
