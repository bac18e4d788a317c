"""Every maze steps, ends and starts as Gymnasium-Robotics' of that kind."""

import jax
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs.suites.maze.maps import FOUR_ROOMS
from tests.envs.suites.gym.oracle import MjxWithEllipticCones
from tests.envs.suites.maze.oracle import RoboticsMaze
from tests.envs.suites.parity import assert_steps_agree

ANT = "maze/ant_umaze"
MAZES = {  # arguments of `RoboticsMaze`
    "maze/point_umaze": ("PointMaze_UMaze-v3",),
    "maze/point_medium": ("PointMaze_Medium-v3",),
    # Gymnasium-Robotics has no four rooms, but takes a map: ours as it writes it.
    "maze/point_fourrooms": (
        "PointMaze_Large-v3",
        [[int(tile == "#") for tile in row] for row in FOUR_ROOMS],
    ),
    ANT: ("AntMaze_UMaze-v5",),
}
MJX_FOR_ALL = "maze/point_umaze"  # stands for all
# How states are found in which a robot touches walls.
OF_THE_BALL, OF_THE_ANT = {"reach": 0.1, "hold": 20}, {"reach": 0.9, "hold": 1}
NUM_DRAWS = 4000


def assert_agree(name, physics, keywords=None, share=1.0, **how):
    """Ours also says whether the goal was reached so far; at walls the two could differ."""
    keywords = keywords or {}
    oracle = RoboticsMaze(*MAZES[name], **keywords)
    env = make_env(name, physics=physics, **keywords)
    model = oracle.robot.model
    model.opt.solver, model.opt.cone = env.model.opt.solver, env.model.opt.cone
    states = oracle.states_at_walls(**(OF_THE_ANT if name == ANT else OF_THE_BALL))
    desired, actual = assert_steps_agree(env, oracle, states, share=share, **how)
    assert (desired.terms["contacts"].max(axis=0) > 0).mean() > 0.03
    assert 0.1 < desired.terms["reached"].mean() < 0.9
    reached = np.logical_or.accumulate(desired.terms["reached"])
    assert (actual.terms["success"] == reached).mean() >= share


@pytest.mark.parametrize("name", MAZES)
def test_native_steps_as_gymnasium_robotics(name):
    assert_agree(name, "native")


@pytest.mark.parametrize(
    ("name", "keywords"),
    [("maze/point_umaze", {}), (ANT, {"include_cfrc_ext_in_observation": False})],
)
def test_dense_reward_and_an_end_at_the_goal_are_gymnasium_robotics(name, keywords):
    assert_agree(name, "native", keywords | {"reward_type": "dense", "continuing_task": False})


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.whole if n == MJX_FOR_ALL else pytest.mark.slow)
        for n in MAZES
    ],
)
def test_mjx_steps_as_gymnasium_robotics(name):
    if name == ANT:
        engine = MjxWithEllipticCones(full_budget=True)
        assert_agree(name, engine, num_steps=1, tolerance=2e-3, share=0.9)
    else:
        assert_agree(name, "mjx", num_steps=2)


@pytest.mark.parametrize("name", MAZES)
def test_initial_states_are_gymnasium_robotics(name):
    """Start and goal lie in the cells that the oracle draws, as often and as far from the middle.

    The oracle redraws the start until its cell is not the goal's.
    """
    theirs, env = RoboticsMaze(*MAZES[name]).env, make_env(name, physics="native")
    keys = jax.random.split(jax.random.key(0), 10_000)
    qpos, qvel = jax.device_get(jax.jit(jax.vmap(env.sample_initial))(keys))
    rows = []
    for seed in range(NUM_DRAWS):
        super(type(theirs), theirs).reset(seed=seed)  # without the physics
        rows.append((theirs.reset_pos, theirs.goal))
    draws = (qpos[:, :2], qpos[:, -2:]), np.array(rows).swapaxes(0, 1)

    np.testing.assert_array_equal(qpos[:, 2:-2], np.tile(env.model.qpos0[2:-2], (len(qpos), 1)))
    assert not qvel.any()
    cells = np.array(theirs.maze.unique_goal_locations)
    std = np.sqrt(1 / len(cells) * (1 / NUM_DRAWS + 1 / len(keys)))
    found = [[nearest(places, cells) for places in both] for both in draws]
    for ours, desired in zip(*found, strict=True):
        frequency, wanted = (np.bincount(x, minlength=len(cells)) / len(x) for x in (ours, desired))
        np.testing.assert_allclose(frequency, wanted, atol=5 * std)
    assert all((starts != goals).all() for starts, goals in found)
    offsets = [
        np.concatenate(places, axis=1) - cells[np.stack(indices, axis=1)].reshape(-1, 4)
        for places, indices in zip(draws, found, strict=True)
    ]
    width = offsets[1].max(axis=0) - offsets[1].min(axis=0)
    for quantile in (0, 0.25, 0.5, 0.75, 1):
        ours, desired = (np.quantile(x, quantile, axis=0) for x in offsets)
        np.testing.assert_array_less(np.abs(ours - desired) / width, 0.03)


def nearest(places, cells):
    """Return which cell [N] each place [N, 2] lies in."""
    return np.linalg.norm(places[:, None] - cells, axis=-1).argmin(axis=1)
