"""How many solver iterations MJX needs: its error after one control step, by budget.

    python benchmarks/solver_budget.py hopper

From states of random trajectories, MJX (float32) and MuJoCo C (float64, its full budget) take the
same control step; the error of a state is the largest difference of any coordinate: its maximum,
95 % quantile and median over the states are shown. A task's `MJX_BUDGET` is the cheapest budget
whose error equals that of the full one, plus an iteration to spare. Time is that of one control
step of all the states, on this machine.
"""

import argparse
import copy
import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import mujoco
import numpy as np
from mujoco import mjx

from hitmdp_jax import list_envs, make_env
from hitmdp_jax.envs.base import MujocoEnv

FULL = (100, 50)  # iterations and line-search iterations, MuJoCo's defaults
ITERATIONS = (8, 6, 5, 4, 3, 2, 1)
LS_ITERATIONS = (4, 2)  # each is a program of its own to compile
CHUNK = 64  # states at a time: with 256 humanoids, jaxlib 0.10 hangs on a CPU
TRAJECTORY_STEPS = 128
STRIDE = 4  # between the states of a trajectory that are used


class States(NamedTuple):
    """What a control step starts from, float32, for N states."""

    qpos: np.ndarray  # [N, nq]
    qvel: np.ndarray  # [N, nv]
    qacc_warmstart: np.ndarray  # [N, nv]
    ctrl: np.ndarray  # [N, nu]


class _Cap:
    """A traced cap on the solver's iterations, so that one compiled program serves every cap.

    MJX compares the cap with 1 in Python, to leave out a loop, and with its counter in JAX.
    """

    def __init__(self, value: jax.Array):
        self._value = value

    def __eq__(self, other: object) -> bool:
        return False

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __jax_array__(self) -> jax.Array:
        return self._value


def sample_states(env: MujocoEnv, model: mujoco.MjModel, num_states: int) -> States:
    """Sample states, warm starts and uniform actions along random trajectories in MuJoCo C."""
    rng = np.random.default_rng(0)
    low, high = model.actuator_ctrlrange.T
    data = mujoco.MjData(model)
    rows = []
    for trajectory in range(-(-num_states * STRIDE // TRAJECTORY_STEPS)):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = env.sample_initial(jax.random.key(trajectory))
        for step in range(TRAJECTORY_STEPS):
            data.ctrl[:] = rng.uniform(low, high)
            if step % STRIDE == 0:
                row = (data.qpos, data.qvel, data.qacc_warmstart, data.ctrl)
                rows.append([field.astype(np.float32) for field in row])
            mujoco.mj_step(model, data, env.physics.frame_skip)
    return States(*(np.array(field[:num_states]) for field in zip(*rows, strict=True)))


def exact_step(model: mujoco.MjModel, states: States, frame_skip: int) -> np.ndarray:
    """Return qpos [N, nq] after one control step of MuJoCo C."""
    data = mujoco.MjData(model)
    result = []
    for row in zip(*states, strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:], data.ctrl[:] = row
        mujoco.mj_step(model, data, frame_skip)
        result.append(data.qpos.copy())
    return np.array(result)


def make_mjx_step(
    model: mujoco.MjModel, ls_iterations: int, frame_skip: int
) -> Callable[[States, int], np.ndarray]:
    """Return the control step of MJX: (states, iterations) -> qpos [N, nq]."""
    model = copy.copy(model)
    model.opt.ls_iterations = ls_iterations
    mjx_model = mjx.put_model(model)
    blank = mjx.make_data(model)

    def step(states: States, iterations: jax.Array) -> jax.Array:
        capped = mjx_model.tree_replace({"opt.iterations": _Cap(iterations)})
        data = blank.replace(**states._asdict())
        data, _ = jax.lax.scan(lambda d, _: (mjx.step(capped, d), None), data, length=frame_skip)
        return data.qpos

    batched_step = jax.jit(jax.vmap(step, in_axes=(0, None)))

    def step_in_chunks(states: States, iterations: int) -> np.ndarray:
        chunks = [
            batched_step(States(*(field[start : start + CHUNK] for field in states)), iterations)
            for start in range(0, len(states.qpos), CHUNK)
        ]
        return np.concatenate(jax.device_get(chunks))

    return step_in_chunks


def main() -> None:
    """Print a table of budgets, errors and times."""
    parser = argparse.ArgumentParser(description="How many solver iterations MJX needs.")
    parser.add_argument("env", choices=list_envs())
    parser.add_argument("--num-states", type=int, default=256)
    parser.add_argument("--ls-iterations", type=int, nargs="+", default=LS_ITERATIONS)
    args = parser.parse_args()

    env = make_env(args.env, physics="mjx")
    assert isinstance(env, MujocoEnv), "only MuJoCo tasks have a solver"
    frame_skip = env.physics.frame_skip
    model = env.model
    model.opt.iterations, model.opt.ls_iterations = FULL
    states = sample_states(env, model, args.num_states)
    exact = exact_step(model, states, frame_skip)

    print(f"{args.env}: one control step from {args.num_states} states against MuJoCo C")
    print("iterations  ls_iterations  max |dqpos|      95 %    median  time (ms)")
    for ls_iterations in (FULL[1], *args.ls_iterations):
        step = make_mjx_step(model, ls_iterations, frame_skip)
        for iterations in (FULL[0], *ITERATIONS):
            step(states, iterations)  # compiles
            start = time.perf_counter()
            error = np.abs(step(states, iterations) - exact).max(axis=1)
            milliseconds = 1e3 * (time.perf_counter() - start)
            quantiles = "  ".join(f"{q:8.1e}" for q in np.quantile(error, (0.95, 0.5)))
            print(
                f"{iterations:10d}  {ls_iterations:13d}  {error.max():11.1e}  {quantiles}  "
                f"{milliseconds:9.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
