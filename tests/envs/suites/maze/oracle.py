"""Gymnasium-Robotics as the oracle."""

import warnings

import gymnasium
import mujoco
import numpy as np

from tests.envs.suites.parity import Oracle, random_actions

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)

NUM_STATES = 200
CLOSE = 0.2  # m beyond NEAR: half of the goals are drawn so close that they are reached or missed
NEAR = 0.45
SPEED = 3.0  # m/s along x and y, at most, at the start


class RoboticsMaze(Oracle):
    """A maze of Gymnasium-Robotics, with the goal where our qpos and qvel have it.

    Args:
      name: "PointMaze_UMaze-v3".
      maze_map: in place of its own.
      **keywords: of the task.
    """

    def __init__(self, name, maze_map=None, **keywords):
        if maze_map is not None:
            keywords["maze_map"] = maze_map
        self.env = gymnasium.make(name, **keywords).unwrapped
        # The Gymnasium environment of the robot alone.
        self.robot = getattr(self.env, "point_env", None) or self.env.ant_env
        self.low, self.high = self.robot.action_space.low, self.robot.action_space.high
        self.dt, self.limit = self.robot.dt, gymnasium.spec(name).max_episode_steps
        geoms = range(self.robot.model.ngeom)
        self.walls = [i for i in geoms if self.robot.model.geom(i).name.startswith("block")]

    def reset(self, rng):
        self.env.reset(seed=int(rng.integers(2**31)))

    def state(self):
        qpos, qvel = self.robot.data.qpos, self.robot.data.qvel
        return np.append(qpos, self.env.goal), np.append(qvel, np.zeros(2))

    def set_state(self, qpos, qvel):
        mujoco.mj_resetData(self.robot.model, self.robot.data)  # the warm start and forces, too
        self.robot.set_state(np.float64(qpos[:-2]), np.float64(qvel[:-2]))
        self.env.goal = np.float64(qpos[-2:])
        seen = self.robot._get_obs()
        return _flat(self.env._get_obs(seen[0] if isinstance(seen, tuple) else seen))

    def step(self, action):
        """The terms are whether the goal is reached, and the contacts with walls."""
        obs, reward, terminated, _, info = self.env.step(action)
        contacts = np.isin(self.robot.data.contact.geom, self.walls).sum()
        terms = {"reached": info["success"], "contacts": contacts}
        return _flat(obs), reward, terminated, terms

    def states_at_walls(self, reach, hold):
        """Return states of random trajectories: float32 qpos [N, nq], qvel [N, nv].

        Each starts in a free cell, `reach` from one of its sides, and goes on for up to 40 steps,
        every action held for `hold` of them, so that many states touch walls.
        """
        rng, robot, maze = np.random.default_rng(0), self.robot, self.env.maze
        states = []
        for row in range(NUM_STATES):
            self.reset(rng)
            cell = maze.unique_reset_locations[rng.integers(len(maze.unique_reset_locations))]
            half = maze.maze_size_scaling / 2 - reach
            qpos, qvel = robot.init_qpos.copy(), robot.init_qvel.copy()
            offset = rng.uniform(-half, half, 2)
            offset[rng.integers(2)] = rng.choice([-half, half])
            qpos[:2] = cell + offset
            qvel[:2] = rng.uniform(-SPEED, SPEED, 2)
            robot.set_state(qpos, qvel)
            for step in range(rng.integers(1, 41)):
                if step % hold == 0:
                    action = random_actions(self, (), rng)
                robot.step(action)
            if row % 2 == 0:
                around = rng.uniform(-NEAR - CLOSE, NEAR + CLOSE, 2)
                self.env.goal = robot.data.qpos[:2] + around
            states.append(self.state())
        qpos, qvel = zip(*states, strict=True)
        return np.float32(qpos), np.float32(qvel)


def _flat(observation):
    parts = ("observation", "achieved_goal", "desired_goal")
    return np.concatenate([observation[part] for part in parts])
