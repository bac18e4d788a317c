"""Gymnasium as the oracle: its tasks and ours, stepped from the same states under the same actions.

What the tests of a suite compare is written here once.
"""

import dataclasses

import gymnasium
import jax
import mujoco
import numpy as np
from numpy.typing import NDArray

from hitmdp_jax import make_env
from hitmdp_jax.physics import MjxEngine
from tests.envs.suites.gym.trained_states import trained_states

GYMNASIUM_NAMES = {
    "halfcheetah": "HalfCheetah",
    "swimmer": "Swimmer",
    "humanoidstandup": "HumanoidStandup",
    "reacher": "Reacher",
    "walker2d": "Walker2d",
    "hopper": "Hopper",
    "invertedpendulum": "InvertedPendulum",
    "inverteddoublependulum": "InvertedDoublePendulum",
    "ant": "Ant",
    "humanoid": "Humanoid",
}
# Version 4 has other names for some terms; ours are version 5's.
V4_TERMS = {
    "reward_run": "reward_forward",
    "reward_fwd": "reward_forward",
    "reward_linvel": "reward_forward",
    "reward_quadctrl": "reward_ctrl",
    "reward_alive": "reward_survive",
}
NUM_STATES = 100
TRAJECTORY_STEPS = 40  # long enough for the unstable ones to fall
TRAJECTORY_STRIDE = 4


@dataclasses.dataclass
class Steps:
    """T control steps from N states: what the agent sees of them."""

    initial_obs: NDArray  # [N, O]
    obs: NDArray  # [T, N, O]
    reward: NDArray  # [T, N]
    terminated: NDArray  # [T, N]
    terms: dict[str, NDArray]  # [T, N] each


def gymnasium_env(name, version, **kwargs):
    return gymnasium.make(f"{GYMNASIUM_NAMES[name]}-{version}", **kwargs).unwrapped


def time_limit(name, version):
    return gymnasium.spec(f"{GYMNASIUM_NAMES[name]}-{version}").max_episode_steps


def random_states(env, num_states=NUM_STATES, seed=0):
    """Return states of random trajectories, healthy or not: float32 qpos [N, nq], qvel [N, nv]."""
    rng = np.random.default_rng(seed)
    states = []
    while len(states) < num_states:
        env.reset(seed=int(rng.integers(2**31)))
        for step in range(1, TRAJECTORY_STEPS + 1):
            env.step(random_actions(env, (), rng))
            if step % TRAJECTORY_STRIDE == 0:
                states.append((env.data.qpos.copy(), env.data.qvel.copy()))
    qpos, qvel = zip(*states[:num_states], strict=True)
    return np.float32(qpos), np.float32(qvel)


def random_actions(env, shape, rng):
    low, high = env.action_space.low, env.action_space.high
    return rng.uniform(low, high, (*shape, *low.shape)).astype(np.float32)


class MjxWithEllipticCones(MjxEngine):
    """MJX with elliptic friction cones.

    Cones have no orientation. Gymnasium's models have pyramids, which MJX lays along other axes
    than MuJoCo C does where a capsule stands steeply on the floor.
    """

    def prepare(self, model, budget=None):
        super().prepare(model, budget)
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC


def gymnasium_steps(env, qpos, qvel, actions):
    """Step Gymnasium from N states under actions [T, N, A]."""
    initial, trajectories = [], []
    for row in range(len(qpos)):
        mujoco.mj_resetData(env.model, env.data)  # the warm start and the forces, too
        env.set_state(np.float64(qpos[row]), np.float64(qvel[row]))
        initial.append(env._get_obs())
        trajectories.append([env.step(action) for action in actions[:, row]])

    def stack(pick):
        return np.array([[pick(step) for step in row] for row in trajectories]).swapaxes(0, 1)

    names = [key for key, value in trajectories[0][0][4].items() if np.ndim(value) == 0]
    return Steps(
        initial_obs=np.array(initial),
        obs=stack(lambda step: step[0]),
        reward=stack(lambda step: step[1]),
        terminated=stack(lambda step: step[2]),
        terms={name: stack(lambda step, name=name: step[4][name]) for name in names},
    )


def our_steps(env, qpos, qvel, actions):
    """Step our environment from N states under actions [T, N, A], as one compiled program."""

    @jax.jit
    @jax.vmap
    def run(qpos, qvel, actions):
        def step(state, action):
            state = env.step(state, action)
            return state, (state.obs, state.reward, state.done, state.metrics)

        first = env.reset_to(qpos, qvel)
        return first.obs, jax.lax.scan(step, first, actions)[1]

    initial_obs, steps = run(qpos, qvel, actions.swapaxes(0, 1))
    obs, reward, done, terms = jax.tree.map(lambda x: np.asarray(x).swapaxes(0, 1), steps)
    return Steps(np.asarray(initial_obs), obs, reward, done.astype(bool), terms)


def assert_near(actual, desired, tolerance, share, what):
    """Enough states [N, ...] are off by at most `tolerance`, relative to values beyond 1."""
    assert actual.shape == desired.shape, f"{what}: {actual.shape} for {desired.shape}"
    error = np.abs(actual - desired) / np.maximum(1.0, np.abs(desired))
    error = error.reshape(len(error), -1).max(axis=1)
    assert np.quantile(error, share) <= tolerance, (
        f"{what}: off by {np.quantile(error, share):.1e}; worst in state {error.argmax()}: "
        f"{actual[error.argmax()]} for {desired[error.argmax()]}"
    )


def assert_steps_agree(
    name,
    version,
    physics,
    num_steps=4,
    tolerance=1e-3,
    share=1.0,
    ignored_terms=(),
    **task_kwargs,
):
    """Ours gives Gymnasium's observation, reward, terms and termination at every step.

    The steps start from 100 states of random trajectories and 100 of a trained policy's. `share` of
    the states must agree; less than all where float32 makes a contact that float64 misses. The
    tolerance is relative to values beyond 1 and absolute below. Gymnasium gets the solver and the
    friction cones of our model, which are its own for `physics="native"`.
    """
    oracle = gymnasium_env(name, version, **task_kwargs)
    env = make_env(name, physics=physics, version=version, **task_kwargs)
    oracle.model.opt.solver, oracle.model.opt.cone = env.model.opt.solver, env.model.opt.cone
    states = random_states(oracle), trained_states(name)
    qpos, qvel = (np.concatenate(parts) for parts in zip(*states, strict=True))
    rng = np.random.default_rng(1)
    actions = random_actions(oracle, (num_steps, len(qpos)), rng)
    desired = gymnasium_steps(oracle, qpos, qvel, actions)
    actual = our_steps(env, qpos, qvel, actions)

    assert env.observation_size == desired.obs.shape[-1]
    assert env.action_size == oracle.action_space.shape[0]
    assert env.episode_length == time_limit(name, version)
    assert env.dt == oracle.dt
    assert_near(actual.initial_obs, desired.initial_obs, tolerance, share, "initial observation")
    for step in range(num_steps):
        assert_near(actual.obs[step], desired.obs[step], tolerance, share, f"observation {step}")
        assert_near(actual.reward[step], desired.reward[step], tolerance, share, f"reward {step}")
    assert (actual.terminated == desired.terminated).mean() >= share
    compared = set(env.reward_terms) - set(ignored_terms)
    for name_there, values in desired.terms.items():
        for term in {name_there, V4_TERMS.get(name_there)} & compared:
            for step in range(num_steps):
                assert_near(actual.terms[term][step], values[step], tolerance, share, term)
    assert not actual.terms["unstable"].any()


def assert_initial_states_agree(name, version, num_draws=10_000, **task_kwargs):
    """Our reset draws from the distribution Gymnasium's reset draws from: mean, std and bounds."""
    oracle = gymnasium_env(name, version, **task_kwargs)
    env = make_env(name, physics="native", version=version, **task_kwargs)
    keys = jax.random.split(jax.random.key(0), num_draws)
    ours = np.concatenate(jax.jit(jax.vmap(env.sample_initial))(keys), axis=-1)
    theirs = []
    oracle.set_state = lambda qpos, qvel: theirs.append(np.concatenate([qpos, qvel]))
    oracle._get_obs = lambda: None
    oracle.reset(seed=0)
    for _ in range(num_draws - 1):
        oracle.reset_model()
    theirs = np.array(theirs)
    scale = np.maximum(theirs.std(axis=0), 1e-6)
    # The difference of two means of n draws has a std of sqrt(2 / n); that of two stds, less.
    bound = 5 * np.sqrt(2 / num_draws)
    np.testing.assert_array_less(np.abs(ours.mean(0) - theirs.mean(0)) / scale, bound)
    np.testing.assert_array_less(np.abs(ours.std(0) / scale - theirs.std(0) / scale), bound)
    uniform = np.abs(theirs - theirs.mean(0)).max(0) < 2 * scale  # sqrt(3) std wide, not 5
    np.testing.assert_allclose(ours.min(0)[uniform], theirs.min(0)[uniform], atol=0.01)
    np.testing.assert_allclose(ours.max(0)[uniform], theirs.max(0)[uniform], atol=0.01)
