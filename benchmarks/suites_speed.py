"""Environment steps per second of other libraries' suites, in our loop and in their own.

`python benchmarks/suites_speed.py` prints a table. `ours` is `VectorEnv` as training has it: it
draws a pool of fresh states once in one or more rollouts, and restarts from it. `own` is what the
library itself offers, under `jax.vmap`: gymnax draws a fresh state at every step and takes it where
an episode has ended, XLand-MiniGrid's `GymAutoResetWrapper` does likewise, and Playground's
wrappers go back to the state in which the environment first began. Craftax's own restart draws a
world at every step, which its authors' training code avoids: it draws one for 16 environments, and
so does `own` here. Both take the same random actions, inside one compiled scan. They take turns,
each of so many rollouts that one pool is drawn, and the table shows each one's median turn.

The last column compares the seconds for which a core was at work: others at work on the machine
change those less than the time that passes. `--tasks` chooses rows. Those of Craftax and Playground
take minutes to compile, which is not measured; stderr says how long it took.
"""

import argparse
import functools
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import hitmdp_jax
from hitmdp_jax.envs.spec import Action, Discrete
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.training.sizes import pool_period, shortest_episode, usual_pool_size

ROLLOUT = 128  # steps
WORLD_FOR = 16  # environments: the usual number of Craftax's authors
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
    refresh: Callable[[Any, jax.Array], Any] = lambda state, key: state  # once in `period` rollouts
    period: int = 1


def ours(env: Any, num_envs: int) -> Loop:
    """Return the loop of this package."""
    shortest = shortest_episode(env)
    vector = VectorEnv(env, num_envs, usual_pool_size(num_envs, ROLLOUT, shortest))

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        state, seen = vector.step(state, action)
        return state, (seen.reward, seen.terminated | seen.truncated, vector.observation(state))

    return Loop(vector.reset, step, vector.refill, pool_period(ROLLOUT, shortest))


def gymnax(env: Any, num_envs: int) -> Loop:
    """Return gymnax's loop."""
    task, params = env.task, env.params

    def start(key: jax.Array) -> Any:
        return jax.vmap(task.reset, (0, None))(jax.random.split(key, num_envs), params)[1]

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        each = jax.vmap(task.step, (0, 0, 0, None))
        out = each(jax.random.split(key, num_envs), state, action, params)
        return out[1], (out[2], out[3], out[0])

    return Loop(start, step)


def craftax(env: Any, num_envs: int) -> Loop:
    """Return Craftax's loop, as its authors train: at each step a world for 16 environments.

    An environment whose episode has ended takes one that no other takes, while there are any.
    """
    task = env.task
    params = task.default_params  # whose `done` has the time limit in it
    fresh = max(1, num_envs // WORLD_FOR)

    def worlds(key: jax.Array, number: int) -> Any:
        return jax.vmap(task.reset_env, (0, None))(jax.random.split(key, number), params)

    def step(state: Any, action: jax.Array, key: jax.Array) -> tuple[Any, Any]:
        key_step, key_world = jax.random.split(key)
        each = jax.vmap(task.step_env, (0, 0, 0, None))
        keys = jax.random.split(key_step, num_envs)
        obs, state, reward, done, _ = each(keys, state, action, params)
        which = (jnp.cumsum(done) - 1) % fresh

        def restart(new: jax.Array, running: jax.Array) -> jax.Array:
            mask = done.reshape(-1, *([1] * (running.ndim - 1)))
            return jnp.where(mask, new[which], running)

        obs, state = jax.tree.map(restart, worlds(key_world, fresh), (obs, state))
        return state, (reward, done, obs)

    return Loop(lambda key: worlds(key, num_envs)[1], step)


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

    def start(key: jax.Array) -> Any:  # its wrappers count the axes of keys of two numbers
        return task.reset(jax.random.key_data(jax.random.split(key, num_envs)))

    return Loop(start, step)


OWN = {"gymnax": gymnax, "xminigrid": xminigrid, "craftax": craftax, "playground": playground}


def random_actions(action: Action, key: jax.Array, num_envs: int) -> jax.Array:
    """Draw actions [B] or [B, A]."""
    if isinstance(action, Discrete):
        return jax.random.randint(key, (num_envs,), 0, action.n)
    low, high = (jnp.asarray(x, jnp.float32) for x in (action.low, action.high))
    return jax.random.uniform(key, (num_envs, action.size), minval=low, maxval=high)


def rollouts(loop: Loop, action: Action, num_envs: int) -> Callable[[int], None]:
    """Compile a loop, and return what goes on by so many rollouts and waits for them."""

    def rollout(state: Any, key: jax.Array, due: jax.Array) -> tuple[Any, Any]:
        def step(state: Any, key: jax.Array) -> tuple[Any, Any]:
            key_action, key_step = jax.random.split(key)
            return loop.step(state, random_actions(action, key_action, num_envs), key_step)

        key_refresh, key_steps = jax.random.split(key)
        if loop.period == 1:
            state = loop.refresh(state, key_refresh)
        else:
            state = jax.lax.cond(due, loop.refresh, lambda state, key: state, state, key_refresh)
        return jax.lax.scan(step, state, jax.random.split(key_steps, ROLLOUT))

    keys = iter(jax.random.split(jax.random.key(1), 100_000))
    state = jax.jit(loop.start)(jax.random.key(0))
    # Once: a call would compile it again for the weaker types of what `start` returns.
    rollout = jax.jit(rollout).lower(state, next(keys), jnp.array(True)).compile()

    def go_on(times: int) -> None:
        nonlocal state
        for i in range(times):
            state, kept = rollout(state, next(keys), jnp.array(i % loop.period == 0))
            jax.block_until_ready(kept)

    go_on(1)
    return go_on


def seconds_of(call: Callable[[], Any]) -> tuple[float, float]:
    """Return how long a call takes, and for how long a core is at work."""
    started, at_work = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - started, time.process_time() - at_work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", default=TASKS)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--turns", type=int, default=9)
    arguments = parser.parse_args()
    num_envs = arguments.num_envs
    columns = [f"task, {num_envs} environments", "ours", "own", "ratio", "ratio of core time"]
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for name in arguments.tasks:
        env: Any = hitmdp_jax.make_env(name)
        own = OWN[name.split("/")[0]]
        loops = [make(env, num_envs) for make in (ours, own)]
        started = time.perf_counter()
        calls = [rollouts(loop, env.spec.action, num_envs) for loop in loops]
        taken = time.perf_counter() - started
        print(f"{name}: compiled in {taken:.0f} s", file=sys.stderr, flush=True)
        times = max(loop.period for loop in loops)
        turns = np.array(
            [
                [seconds_of(functools.partial(call, times)) for call in calls]
                for _ in range(arguments.turns)
            ]
        )  # [turns, ours and own, both clocks]
        mine, theirs = times * ROLLOUT * num_envs / np.median(turns[:, :, 0], axis=0)
        ratio, at_work = np.median(turns[:, 1] / turns[:, 0], axis=0)
        print(
            f"| `{name}` | {mine:,.0f} | {theirs:,.0f} | {ratio:.2f} | {at_work:.2f} |", flush=True
        )


if __name__ == "__main__":
    main()
