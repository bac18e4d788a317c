"""DeepMind Control as the oracle: its tasks and ours, from the same states under the same actions.

A task that the suite lacks is one of its tasks with the reward that `test_tasks.py` states, written
with dm_control's own `tolerance`.
"""

import dataclasses
from collections.abc import Callable

import jax
import mujoco
import numpy as np
from dm_control.mujoco.wrapper.mjbindings import sizes
from numpy.typing import NDArray

from hitmdp_jax import make_env
from tests.envs.suites.gym.parity import assert_near, our_steps
from tests.envs.suites.gym.trained_states import trained_states

# dm_control lists the fields of MuJoCo's structures, among them some that MuJoCo 4 no longer has,
# and looks for each of them whenever it loads a model.
_MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
for _name, _struct in (("mjmodel", _MODEL), ("mjdata", mujoco.MjData(_MODEL))):
    for _field in [field for field in sizes.array_sizes[_name] if not hasattr(_struct, field)]:
        del sizes.array_sizes[_name][_field]

from dm_control import suite  # noqa: E402

NUM_STATES = 100
NUM_TRAJECTORIES = 10
STRIDE = 10  # control steps between the states of a trajectory that are used


@dataclasses.dataclass(frozen=True)
class Oracle:
    """A task of the suite."""

    domain: str
    task: str
    reward: Callable | None = None  # physics -> reward, where it is not the suite's
    # Places of the model's geoms that an episode draws, which our state holds behind the joints.
    drawn_geom: str | None = None

    def load(self, seed=0):
        env = suite.load(self.domain, self.task, task_kwargs={"random": seed})
        if self.reward is not None:
            env.task.get_reward = self.reward
        return env

    def get_state(self, env):
        """Return qpos [nq] and qvel [nv] as ours."""
        qpos, qvel = env.physics.data.qpos.copy(), env.physics.data.qvel.copy()
        if self.drawn_geom is not None:
            place = env.physics.named.model.geom_pos[self.drawn_geom, :2]
            qpos, qvel = np.concatenate([qpos, place]), np.concatenate([qvel, np.zeros(2)])
        return np.float32(qpos), np.float32(qvel)

    def set_state(self, env, qpos, qvel):
        nq, nv = env.physics.model.nq, env.physics.model.nv
        with env.physics.reset_context():
            env.physics.data.qpos[:], env.physics.data.qvel[:] = qpos[:nq], qvel[:nv]
            if self.drawn_geom is not None:
                env.physics.named.model.geom_pos[self.drawn_geom, :2] = qpos[nq:]


def flatten(observation):
    return np.concatenate([np.ravel(value) for value in observation.values()])


def random_actions(env, shape, rng):
    spec = env.action_spec()
    return np.float32(rng.uniform(spec.minimum, spec.maximum, (*shape, *spec.shape)))


def random_states(oracle):
    """Return states of random trajectories: float32 qpos [N, nq], qvel [N, nv]."""
    env, rng = oracle.load(), np.random.default_rng(0)
    states = []
    for _ in range(NUM_TRAJECTORIES):
        env.reset()
        for _ in range(NUM_STATES // NUM_TRAJECTORIES):
            for _ in range(STRIDE):
                env.step(random_actions(env, (), rng))
            states.append(oracle.get_state(env))
    qpos, qvel = zip(*states, strict=True)
    return np.array(qpos), np.array(qvel)


def oracle_steps(oracle, qpos, qvel, actions):
    """Return first observations [N, O], observations [T, N, O] and rewards [T, N]."""
    env = oracle.load()
    env.reset()
    first, obs, reward = [], [], []
    for row in range(len(qpos)):
        oracle.set_state(env, qpos[row], qvel[row])
        first.append(flatten(env.task.get_observation(env.physics)))
        steps = [env.step(action) for action in actions[:, row]]
        obs.append([flatten(step.observation) for step in steps])
        reward.append([step.reward for step in steps])
    return np.array(first), np.array(obs).swapaxes(0, 1), np.array(reward).swapaxes(0, 1)


def assert_steps_agree(
    name: str,
    oracle: Oracle,
    physics,
    states: tuple[NDArray, NDArray],
    num_steps=4,
    tolerance=1e-3,
):
    """Ours gives the oracle's observation and reward at every step.

    The steps start from `states` and from a trained policy's. The tolerance is relative to values
    beyond 1 and absolute below.
    """
    theirs = oracle.load()
    visited = states, trained_states(name)
    qpos, qvel = (np.concatenate(parts) for parts in zip(*visited, strict=True))
    actions = random_actions(theirs, (num_steps, len(qpos)), np.random.default_rng(1))
    first, obs, reward = oracle_steps(oracle, qpos, qvel, actions)
    env = make_env(name, physics=physics)
    actual = our_steps(env, qpos, qvel, actions)

    assert len(qpos) >= 2 * NUM_STATES
    assert env.observation_size == obs.shape[-1]
    assert env.action_size == theirs.action_spec().shape[0]
    assert env.dt == theirs.control_timestep()
    assert env.episode_length == round(theirs._step_limit)
    assert_near(actual.initial_obs, first, tolerance, 1.0, "initial observation")
    for step in range(num_steps):
        assert_near(actual.obs[step], obs[step], tolerance, 1.0, f"observation {step}")
        assert_near(actual.reward[step], reward[step], tolerance, 1.0, f"reward {step}")
    assert reward.std() > 0, "these states and actions do not tell one reward from another"
    assert not actual.terminated.any()
    assert not actual.terms["unstable"].any()


def assert_initial_states_agree(name: str, oracle: Oracle, num_draws=2000, num_ours=None):
    """Our reset draws from the oracle's distribution: mean, std, and the bounds of the bounded.

    Of our draws, `num_ours` are independent; all are, by default.
    """
    env = make_env(name, physics="native")
    keys = jax.random.split(jax.random.key(0), 10_000)
    ours = np.float64(np.concatenate(jax.jit(jax.vmap(env.sample_initial))(keys), axis=-1))
    suite_env = oracle.load()
    theirs = []
    for _ in range(num_draws):
        suite_env.reset()
        theirs.append(np.concatenate(oracle.get_state(suite_env)))
    theirs = np.float64(theirs)

    deviation = theirs - theirs.mean(axis=0)
    scale = np.maximum(deviation.std(axis=0), 1e-6)
    # The variance of a mean of n draws is that of one over n; of their std, (kurtosis - 1) / 4n.
    one = np.sqrt(1 / num_draws + 1 / (num_ours or len(ours)))
    kurtosis = ((deviation / scale) ** 4).mean(axis=0)
    of_std = one * np.sqrt(np.maximum(kurtosis - 1, 0) / 4) + 1e-6
    assert (np.abs(ours.mean(0) - theirs.mean(0)) / scale <= 5 * one + 1e-6).all()
    assert (np.abs(ours.std(0) - theirs.std(0)) / scale <= 5 * of_std).all()
    bounded = kurtosis < 2.2  # uniform: 1.8; normal: 3
    width = 4 * scale[bounded]  # of a uniform one: 3.5
    assert (np.abs(ours.min(0) - theirs.min(0))[bounded] <= 0.03 * width).all()
    assert (np.abs(ours.max(0) - theirs.max(0))[bounded] <= 0.03 * width).all()
