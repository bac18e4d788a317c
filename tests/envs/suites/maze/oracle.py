"""Gymnasium-Robotics as the oracle: its mazes and ours, from the same states, goals and actions."""

import dataclasses
import warnings

import gymnasium
import jax
import mujoco
import numpy as np
from numpy.typing import NDArray

from hitmdp_jax import make_env
from hitmdp_jax.envs import check_env
from tests.envs.suites.gym.parity import assert_near, our_steps, random_actions

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)

NUM_STATES = 200
CLOSE = 0.2  # m beyond NEAR: half of the goals are drawn so close that they are reached or missed
NEAR = 0.45
SPEED = 3.0  # m/s along x and y, at most, at the start


@dataclasses.dataclass(frozen=True)
class Oracle:
    """A maze of Gymnasium-Robotics."""

    name: str  # "PointMaze_UMaze-v3"
    maze_map: list[list[int]] | None = None  # in place of its own

    def make(self, **kwargs):
        if self.maze_map is not None:
            kwargs["maze_map"] = self.maze_map
        return gymnasium.make(self.name, **kwargs).unwrapped


def robot_of(oracle):
    """Return the Gymnasium environment of the robot alone."""
    return oracle.point_env if hasattr(oracle, "point_env") else oracle.ant_env


def set_state(oracle, qpos, qvel):
    """Put the robot and the goal where our qpos and qvel have them; return the observation."""
    robot = robot_of(oracle)
    mujoco.mj_resetData(robot.model, robot.data)  # the warm start and the forces, too
    robot.set_state(np.float64(qpos[:-2]), np.float64(qvel[:-2]))
    oracle.goal = np.float64(qpos[-2:])
    seen = robot._get_obs()
    return oracle._get_obs(seen[0] if isinstance(seen, tuple) else seen)


def flatten(observation):
    parts = ("observation", "achieved_goal", "desired_goal")
    return np.concatenate([observation[part] for part in parts])


def random_states(oracle, reach, hold, num_states=NUM_STATES, seed=0):
    """Return states of random trajectories: float32 qpos [N, nq], qvel [N, nv], goals included.

    Each starts in a free cell, `reach` from one of its sides, and goes on for up to 40 steps, every
    action held for `hold` of them, so that many states touch walls.
    """
    rng = np.random.default_rng(seed)
    robot, maze = robot_of(oracle), oracle.maze
    states = []
    for row in range(num_states):
        oracle.reset(seed=int(rng.integers(2**31)))
        cell = maze.unique_reset_locations[rng.integers(len(maze.unique_reset_locations))]
        half = maze.maze_size_scaling / 2 - reach
        qpos = robot.init_qpos.copy()
        offset = rng.uniform(-half, half, 2)
        offset[rng.integers(2)] = rng.choice([-half, half])
        qpos[:2] = cell + offset
        qvel = robot.init_qvel.copy()
        qvel[:2] = rng.uniform(-SPEED, SPEED, 2)
        robot.set_state(qpos, qvel)
        for step in range(rng.integers(1, 41)):
            if step % hold == 0:
                action = random_actions(robot, (), rng)
            robot.step(action)
        place = robot.data.qpos[:2]
        goal = oracle.goal if row % 2 else place + rng.uniform(-NEAR - CLOSE, NEAR + CLOSE, 2)
        states.append((np.append(robot.data.qpos, goal), np.append(robot.data.qvel, np.zeros(2))))
    qpos, qvel = zip(*states, strict=True)
    return np.float32(qpos), np.float32(qvel)


@dataclasses.dataclass
class Steps:
    """T control steps from N states, as the oracle sees them."""

    initial_obs: NDArray  # [N, O]
    obs: NDArray  # [T, N, O]
    reward: NDArray  # [T, N]
    terminated: NDArray  # [T, N]
    success: NDArray  # [T, N] whether the goal is reached in this step
    contacts: NDArray  # [T, N] contacts with walls


def oracle_steps(oracle, qpos, qvel, actions):
    """Step the oracle from N states under actions [T, N, A]."""
    robot = robot_of(oracle)
    walls = [i for i in range(robot.model.ngeom) if robot.model.geom(i).name.startswith("block")]
    initial, rows = [], []
    for row in range(len(qpos)):
        initial.append(flatten(set_state(oracle, qpos[row], qvel[row])))
        steps = []
        for action in actions[:, row]:
            obs, reward, terminated, _, info = oracle.step(action)
            contacts = np.isin(robot.data.contact.geom, walls).sum()
            steps.append((flatten(obs), reward, terminated, info["success"], contacts))
        rows.append(steps)

    def stack(place):
        return np.array([[step[place] for step in row] for row in rows]).swapaxes(0, 1)

    return Steps(np.array(initial), *map(stack, range(5)))


def assert_steps_agree(
    name, oracle, physics, reach, hold, num_steps=4, tolerance=1e-3, share=1.0, **task_kwargs
):
    """Ours gives the oracle's observation, reward, termination and success at every step."""
    theirs = oracle.make(**task_kwargs)
    env = make_env(name, physics=physics, **task_kwargs)
    model = robot_of(theirs).model
    model.opt.solver, model.opt.cone = env.model.opt.solver, env.model.opt.cone
    qpos, qvel = random_states(theirs, reach, hold)
    rng = np.random.default_rng(1)
    actions = random_actions(robot_of(theirs), (num_steps, len(qpos)), rng)
    desired = oracle_steps(theirs, qpos, qvel, actions)
    actual = our_steps(env, qpos, qvel, actions)

    assert env.observation_size == desired.obs.shape[-1]
    assert env.dt == robot_of(theirs).dt
    assert (desired.contacts.max(axis=0) > 0).mean() > 0.03  # at walls they could differ
    assert 0.1 < desired.success.mean() < 0.9
    assert_near(actual.initial_obs, desired.initial_obs, tolerance, share, "initial observation")
    for step in range(num_steps):
        assert_near(actual.obs[step], desired.obs[step], tolerance, share, f"observation {step}")
        assert_near(actual.reward[step], desired.reward[step], tolerance, share, f"reward {step}")
    assert (actual.terminated == desired.terminated).mean() >= share
    reached = np.logical_or.accumulate(desired.success)
    assert (actual.terms["success"] == reached).mean() >= share
    assert not actual.terms["unstable"].any()


def assert_initial_states_agree(name, oracle, num_draws=4000):
    """Start and goal lie in the cells that the oracle draws, as often and as far from the middle.

    The oracle redraws the start until its cell is not the goal's.
    """
    theirs, env = oracle.make(), make_env(name, physics="native")
    keys = jax.random.split(jax.random.key(0), 10_000)
    qpos, qvel = jax.device_get(jax.jit(jax.vmap(env.sample_initial))(keys))
    rows = []
    for seed in range(num_draws):
        super(type(theirs), theirs).reset(seed=seed)  # without the physics
        rows.append((theirs.reset_pos, theirs.goal))
    draws = (qpos[:, :2], qpos[:, -2:]), np.array(rows).swapaxes(0, 1)

    np.testing.assert_array_equal(qpos[:, 2:-2], np.tile(env.model.qpos0[2:-2], (len(qpos), 1)))
    assert not qvel.any()
    cells = np.array(theirs.maze.unique_goal_locations)
    std = np.sqrt(1 / len(cells) * (1 / num_draws + 1 / len(keys)))
    found = [(_cells(starts, cells), _cells(goals, cells)) for starts, goals in draws]
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


def _cells(places, cells):
    """Return which cell [N] each place [N, 2] lies in."""
    return np.linalg.norm(places[:, None] - cells, axis=-1).argmin(axis=1)


def as_numbers(rows):
    """Return one of our maps as Gymnasium-Robotics writes it."""
    return [[int(tile == "#") for tile in row] for row in rows]


def assert_limits_agree(name, oracle):
    assert check_env(name).episode_length == gymnasium.spec(oracle.name).max_episode_steps
