import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics

from hitmdp_jax.agents import AHP, IOPG, MOPG, PPO
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import run_episodes, run_in_gymnasium
from tests.interpret.known_returns import Payment, obvious
from tests.probes import Counter, spec_of_sizes, untrained_policy
from tests.programs import compiled

PENDULUM = {"name": "invertedpendulum"}
SMALL = {"hidden_sizes": (8,)}


@functools.partial(jax.jit, static_argnums=(1, 2))
def untrained(agent, observation_size, action_size, key):
    return untrained_policy(agent.bind(spec_of_sizes(observation_size, action_size)), key)


class Staircase(Counter):
    """A counter that ends after a number of steps drawn at its start: 1, 2 or 3 of at most 5."""

    def step(self, state, action):
        state = super().step(state, action)
        last = 1 + jnp.floor(3 * state.obs[1])
        return state.replace(done=(state.obs[0] >= last).astype(float))


@pytest.fixture(scope="module")
def policy():
    return untrained(MOPG(**SMALL), 4, 1, jax.random.key(0))


@pytest.fixture(
    scope="module", params=["native", pytest.param("mjx", marks=pytest.mark.slow), "gymnasium"]
)
def recorded(request, policy):
    key = jax.random.key(1)
    if request.param == "gymnasium":
        return jax.device_get(run_in_gymnasium(policy, PENDULUM, key, 3, physics=True))
    env = make_env(**PENDULUM, physics=request.param)
    env.episode_length = 100  # long enough to fall over
    return jax.device_get(run_episodes(policy, env, key, 3, physics=True))


def test_every_engine_records_the_same_structure(recorded):
    steps = recorded.alive.shape[0]
    assert jax.tree.map(lambda x: (x.shape, x.dtype.name), vars(recorded)) == {
        "obs": ((steps, 3, 4), "float32"),
        "action": ((steps, 3, 1), "float32"),
        "reward": ((steps, 3), "float32"),
        "option": ((steps, 3), "int32"),
        "option_probs": ((steps, 3, 4), "float32"),
        "alive": ((steps, 3), "bool"),
        "control_steps": ((steps, 3), "int32"),
        "terminated": ((3,), "bool"),
        "success": None,
        "qpos": ((steps, 3, 2), "float32"),
        "qvel": ((steps, 3, 2), "float32"),
        "ctrl": ((steps, 3, 1), "float32"),
        "state": None,
    }


def test_observation_option_and_physics_are_of_one_moment(recorded, policy):
    alive = recorded.alive
    # The pendulum shows its generalised coordinates; the control is the clipped action before.
    state = np.concatenate([recorded.qpos, recorded.qvel], axis=-1)
    np.testing.assert_allclose(state[alive], recorded.obs[alive], atol=1e-6)
    before = np.clip(recorded.action[:-1], -3, 3) * alive[1:, :, None]
    np.testing.assert_allclose(recorded.ctrl[1:] * alive[1:, :, None], before, atol=1e-6)

    @compiled
    def option_probs(policy):
        seen = running_statistics.normalize(recorded.obs, policy.normalizer, max_abs_value=10.0)
        return policy.agent.option_probs(policy.params, seen[1:], recorded.option[:-1])

    probs = option_probs(policy)
    np.testing.assert_allclose(
        recorded.option_probs[1:][alive[1:]], probs[alive[1:]], rtol=1e-4, atol=1e-6
    )


def test_an_untrained_pendulum_falls_in_every_engine(recorded):
    assert recorded.terminated.all()
    assert not recorded.truncated.any()
    # v5 gives 1 for every step but the one that ends the episode
    np.testing.assert_array_equal(recorded.returns, recorded.lengths - 1)
    assert recorded.lengths.max() < 200


def test_each_environment_records_its_first_whole_episode_alone(key):
    recorded = jax.device_get(
        run_episodes(untrained(PPO(**SMALL), 2, 1, key), Staircase(), key, 64)
    )
    lengths = 1 + np.floor(3 * np.asarray(recorded.obs[0, :, 1])).astype(int)
    assert set(lengths) == {1, 2, 3}
    np.testing.assert_array_equal(recorded.lengths, lengths)
    np.testing.assert_array_equal(recorded.returns, lengths)
    np.testing.assert_array_equal(recorded.alive, np.arange(5)[:, None] < lengths)
    assert recorded.terminated.all()


def test_the_time_limit_truncates(key):
    recorded = jax.device_get(run_episodes(obvious(), Payment(), key, 2))
    np.testing.assert_array_equal(recorded.lengths, [7, 7])
    assert recorded.truncated.all()
    np.testing.assert_array_equal(recorded.obs[:, 0, 1], np.arange(7))


def test_a_policy_without_options_records_none_and_a_task_without_physics_says_so(key):
    policy = untrained(PPO(**SMALL), 2, 1, key)
    recorded = jax.eval_shape(lambda policy: run_episodes(policy, Counter(), key, 2), policy)
    assert recorded.option is None
    assert recorded.option_probs is None
    with pytest.raises(UsageError, match="no MuJoCo state"):
        run_episodes(policy, Counter(), key, 1, physics=True)


class Drawn(Counter):
    def draw(self, state):
        return np.full((2, 3, 3), 10 * state.obs[0], np.uint8)


def test_a_task_that_draws_itself_has_its_whole_states_recorded(key):
    policy = untrained(PPO(**SMALL), 2, 1, key)
    recorded = jax.device_get(run_episodes(policy, Drawn(), key, 2, physics=True))
    np.testing.assert_array_equal(recorded.state.obs, recorded.obs)
    assert recorded.qpos is None


@pytest.mark.parametrize(("agent", "deterministic"), [(MOPG, True), (AHP, False), (IOPG, False)])
def test_its_own_choices_as_given_options_repeat_an_episode(agent, deterministic, key):
    policy, env = untrained(agent(num_options=3, **SMALL), 2, 1, key), Payment()

    @compiled
    def run_twice(policy):
        run = functools.partial(run_episodes, policy, env, key, 4, deterministic=deterministic)
        own = run()
        return own, run(options=own.option)

    own, again = run_twice(policy)
    if deterministic:
        np.testing.assert_array_equal(own.option, own.option_probs.argmax(-1))
    else:
        assert len(np.unique(own.option)) > 1
    np.testing.assert_allclose(own.option_probs.sum(-1), np.ones((7, 4)), rtol=1e-5)
    np.testing.assert_array_equal(again.option, own.option)
    np.testing.assert_allclose(again.action, own.action, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(again.reward, own.reward, rtol=1e-4, atol=1e-5)


def test_given_options_decide(key):
    options = jnp.array([[2, 0], [1, 1], [0, 2], [2, 0], [1, 1], [0, 2], [2, 0]])
    recorded = jax.device_get(run_episodes(obvious(), Payment(), key, 2, options=options))
    np.testing.assert_array_equal(recorded.option, options)
    np.testing.assert_allclose(recorded.returns, [8, 6], atol=1e-4)


@pytest.mark.parametrize(
    ("task", "what"),
    [
        ({"name": "toy/turkey"}, "environment 'toy/turkey'"),
        ({"name": "dmc/cheetah_run"}, "environment 'dmc/cheetah_run'"),
        ({"name": "brax/ant"}, "environment 'brax/ant'"),
        (PENDULUM | {"hide_velocities": True}, "hide_velocities; use --engine"),
        (PENDULUM | {"action_repeat": 2}, "action_repeat; use --engine"),
    ],
)
def test_gymnasium_has_its_own_tasks_alone(task, what, policy, key):
    with pytest.raises(UsageError, match=f"Gymnasium has no {what}"):
        run_in_gymnasium(policy, task, key, 1)
