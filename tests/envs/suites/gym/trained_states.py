"""States that trained policies visit: gaits, jumps and balance, which random actions never reach.

`python -m tests.envs.suites.gym.trained_states RUN_DIR ...` records those of each run's
task, or of its last one, in place of what was recorded of its model before.
"""

import sys
from pathlib import Path

import jax
import numpy as np

from hitmdp_jax import load, make_env
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.runs.config import RunConfig

FILE = Path(__file__).with_suffix(".npz")
NUM_TRAJECTORIES = 10
STATES_PER_TRAJECTORY = 10
STRIDE = 20  # control steps between two of them


def model_of(task):
    """Return what names a task's model: DeepMind Control has several tasks of each."""
    return task.partition("_")[0]


def trained_states(task):
    """Return float32 qpos [N, nq] and qvel [N, nv]."""
    with np.load(FILE) as recorded:
        return recorded[f"{model_of(task)}/qpos"], recorded[f"{model_of(task)}/qvel"]


def record(run_dir):
    """Return the name of a run's task and the states its first seed visits under noise."""
    task = RunConfig.load(Path(run_dir)).tasks[-1]
    policy = load(run_dir)
    env = VectorEnv(make_env(**task, physics="native"), NUM_TRAJECTORIES, NUM_TRAJECTORIES * STRIDE)

    @jax.jit
    def run(key):
        def step(carry, key):
            state, memory = carry
            action, memory = policy.act(state.env.obs, memory, key)
            state, _ = env.step(state, action)
            data = state.env.pipeline_state
            return (state, memory), (data.qpos, data.qvel)

        key_reset, key_memory, key_steps = jax.random.split(key, 3)
        start = env.reset(key_reset), policy.initial_memory(key_memory, (NUM_TRAJECTORIES,))
        keys = jax.random.split(key_steps, STATES_PER_TRAJECTORY * STRIDE)
        return jax.lax.scan(step, start, keys)[1]

    states = jax.tree.map(lambda x: x[STRIDE - 1 :: STRIDE], run(jax.random.key(0)))
    return task["name"], [np.asarray(x).reshape(-1, x.shape[-1]) for x in states]


def main():
    recorded = dict(np.load(FILE)) if FILE.exists() else {}
    for run_dir in sys.argv[1:]:
        task, (qpos, qvel) = record(run_dir)
        recorded |= {f"{model_of(task)}/qpos": qpos, f"{model_of(task)}/qvel": qvel}
    np.savez_compressed(FILE, **recorded)


if __name__ == "__main__":
    main()
