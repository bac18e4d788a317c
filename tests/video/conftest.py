"""Two episodes of a cart that moves to the right, and the task they are of."""

import numpy as np
import pytest

from hitmdp_jax.envs import make_env
from hitmdp_jax.interpret.episodes import Trajectories

OPTIONS = np.repeat([0, 2, 0, 1], [3, 2, 1, 4])  # of the first episode's ten steps


@pytest.fixture(scope="module")
def env():
    return make_env("invertedpendulum", physics="native")


@pytest.fixture(scope="module")
def recorded():
    """Episodes of ten steps and of four."""
    T, N = 10, 2
    alive = np.stack([np.ones(T, bool), np.arange(T) < 4], axis=1)
    qpos = np.zeros((T, N, 2))
    qpos[..., 0] = np.linspace(-0.9, 0.9, T)[:, None]
    option = np.stack([OPTIONS, np.full(T, 3)], axis=1)
    fields = {
        "obs": np.zeros((T, N, 4)),
        "action": np.zeros((T, N, 1)),
        "reward": alive.astype(float),
        "option": option,
        "option_probs": None,
        "alive": alive,
        "control_steps": alive.astype(int),
        "terminated": np.array([False, True]),
        "qpos": qpos,
        "qvel": np.ones((T, N, 2)),
    }
    return Trajectories(**fields)
