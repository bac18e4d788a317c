"""Tasks of other libraries as oracles: theirs and ours, from the same states and actions.

What the tests of the suites compare is written here once.
"""

import abc
import dataclasses

import jax
import numpy as np
from numpy.typing import NDArray


class Oracle(abc.ABC):
    """A task of another library, with its states as ours have them.

    Attributes:
      low: the least value of each entry of an action [A].
      high: the greatest.
      dt: seconds of a control step.
      limit: the time limit in control steps.
    """

    low: NDArray
    high: NDArray
    dt: float
    limit: int

    @abc.abstractmethod
    def reset(self, rng):
        """Start an episode."""

    @abc.abstractmethod
    def state(self):
        """Return float32 qpos [nq] and qvel [nv]."""

    @abc.abstractmethod
    def set_state(self, qpos, qvel):
        """Go on from a state, with no warm start and no forces; return the observation [O]."""

    @abc.abstractmethod
    def step(self, action):
        """Return the observation [O], the reward, whether the task ended, and terms by name."""

    def initial_states(self, number):
        """Return states that episodes start in, [number, nq + nv]."""
        states = []
        for _ in range(number):
            self.reset(np.random.default_rng(0))
            states.append(np.concatenate(self.state()))
        return np.float64(states)


@dataclasses.dataclass
class Steps:
    """T control steps from N states: what the agent sees of them."""

    initial_obs: NDArray  # [N, O]
    obs: NDArray  # [T, N, O]
    reward: NDArray  # [T, N]
    terminated: NDArray  # [T, N]
    terms: dict[str, NDArray]  # [T, N] each


def random_actions(oracle, shape, rng):
    return np.float32(rng.uniform(oracle.low, oracle.high, (*shape, *oracle.low.shape)))


def random_states(oracle, num_states=100, stride=4, per_trajectory=10):
    """Return states of random trajectories, every `stride` steps: float32 [N, nq], [N, nv]."""
    rng, states = np.random.default_rng(0), []
    while len(states) < num_states:
        oracle.reset(rng)
        for step in range(1, stride * per_trajectory + 1):
            oracle.step(random_actions(oracle, (), rng))
            if step % stride == 0:
                states.append(oracle.state())
    qpos, qvel = zip(*states[:num_states], strict=True)
    return np.array(qpos), np.array(qvel)


def oracle_steps(oracle, qpos, qvel, actions):
    """Step the oracle from N states under actions [T, N, A]."""
    initial, rows = [], []
    for row in range(len(qpos)):
        initial.append(oracle.set_state(qpos[row], qvel[row]))
        rows.append([oracle.step(action) for action in actions[:, row]])

    def stack(pick):
        return np.array([[pick(step) for step in row] for row in rows]).swapaxes(0, 1)

    seen = (stack(lambda step, i=i: step[i]) for i in range(3))
    terms = {name: stack(lambda step, name=name: step[3][name]) for name in rows[0][0][3]}
    return Steps(np.array(initial), *seen, terms)


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


def assert_steps_agree(env, oracle, states, num_steps=4, tolerance=1e-3, share=1.0, ignored=()):
    """Ours gives the oracle's observation, reward, terms and termination at every step.

    `share` of the states must agree; less than all where float32 makes a contact that float64
    misses. The tolerance is relative to values beyond 1 and absolute below.

    Returns:
      The oracle's steps and ours.
    """
    qpos, qvel = states
    actions = random_actions(oracle, (num_steps, len(qpos)), np.random.default_rng(1))
    desired = oracle_steps(oracle, qpos, qvel, actions)
    actual = our_steps(env, qpos, qvel, actions)

    assert env.observation_size == desired.obs.shape[-1]
    assert env.action_size == len(oracle.low)
    assert env.episode_length == oracle.limit
    assert env.dt == oracle.dt
    assert_near(actual.initial_obs, desired.initial_obs, tolerance, share, "initial observation")
    compared = desired.terms.keys() & (set(env.reward_terms) - set(ignored))
    for t in range(num_steps):
        assert_near(actual.obs[t], desired.obs[t], tolerance, share, f"observation {t}")
        assert_near(actual.reward[t], desired.reward[t], tolerance, share, f"reward {t}")
        for term in compared:
            assert_near(actual.terms[term][t], desired.terms[term][t], tolerance, share, term)
    assert (actual.terminated == desired.terminated).mean() >= share
    assert not actual.terms["unstable"].any()
    return desired, actual


def assert_initial_states_agree(env, oracle, num_draws, num_ours=None, bound=np.inf):
    """Our reset draws from the oracle's distribution: mean, std, and the ends of the bounded.

    Of our draws, `num_ours` are independent; all are, by default. Ends may be off by 3 % of the
    distribution's width, and by `bound` at most.
    """
    keys = jax.random.split(jax.random.key(0), 10_000)
    ours = np.float64(np.concatenate(jax.jit(jax.vmap(env.sample_initial))(keys), axis=-1))
    theirs = oracle.initial_states(num_draws)
    deviation = theirs - theirs.mean(axis=0)
    scale = np.maximum(deviation.std(axis=0), 1e-6)
    # The variance of a mean of n draws is that of one over n; of their std, (kurtosis - 1) / 4n.
    one = np.sqrt(1 / num_draws + 1 / (num_ours or len(ours)))
    kurtosis = ((deviation / scale) ** 4).mean(axis=0)
    of_std = one * np.sqrt(np.maximum(kurtosis - 1, 0) / 4) + 1e-6
    assert (np.abs(ours.mean(0) - theirs.mean(0)) / scale <= 5 * one + 1e-6).all()
    assert (np.abs(ours.std(0) - theirs.std(0)) / scale <= 5 * of_std).all()
    bounded = kurtosis < 2.2  # uniform: 1.8; normal: 3
    off = np.minimum(0.03 * 4 * scale[bounded], bound)  # the width of a uniform one is 3.5 std
    assert (np.abs(ours.min(0) - theirs.min(0))[bounded] <= off).all()
    assert (np.abs(ours.max(0) - theirs.max(0))[bounded] <= off).all()
