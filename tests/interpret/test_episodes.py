import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics

from hitmdp_jax.agents import AHP, MOPG, PPO
from hitmdp_jax.envs import make_env
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import run_episodes, run_in_gymnasium
from tests.probes import Counter, Target, spec_of_sizes, untrained_policy
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
    recorded = jax.device_get(run_episodes(untrained(PPO(**SMALL), 2, 1, key), Counter(), key, 2))
    np.testing.assert_array_equal(recorded.lengths, [5, 5])
    assert recorded.truncated.all()
    np.testing.assert_array_equal(recorded.obs[:, 0, 0], np.arange(5))


def test_a_policy_without_options_records_none(key):
    recorded = jax.device_get(run_episodes(untrained(PPO(**SMALL), 1, 1, key), Target(), key, 2))
    assert recorded.option is None
    assert recorded.option_probs is None


def test_an_option_is_told_from_what_else_an_agent_notes(key):
    recorded = jax.device_get(
        run_episodes(untrained(AHP(num_options=3, **SMALL), 2, 1, key), Counter(), key, 2)
    )
    assert recorded.option.shape == (5, 2)
    np.testing.assert_allclose(recorded.option_probs.sum(-1), np.ones((5, 2)), rtol=1e-5)


def test_deterministic_episodes_take_the_likeliest_option(key):
    policy = untrained(MOPG(**SMALL), 2, 1, key)
    recorded = jax.device_get(run_episodes(policy, Counter(), key, 4, deterministic=True))
    np.testing.assert_array_equal(recorded.option, recorded.option_probs.argmax(-1))


def test_policies_of_many_seeds_are_recorded_at_once(key):
    env, keys = Staircase(), jax.random.split(key, 2)

    @jax.jit
    def record_each(keys):
        policies = jax.vmap(lambda key: untrained(MOPG(**SMALL), 2, 1, key))(keys)
        return policies, jax.vmap(lambda policy, key: run_episodes(policy, env, key, 3))(
            policies, keys
        )

    policies, together = jax.device_get(record_each(keys))
    assert together.option_probs.shape == (2, 5, 3, 4)
    for i in range(2):
        alone = jax.device_get(
            run_episodes(jax.tree.map(lambda x, i=i: x[i], policies), env, keys[i], 3)
        )
        np.testing.assert_array_equal(together.lengths[i], alone.lengths)
        np.testing.assert_array_equal(together.option[i], alone.option)
        np.testing.assert_allclose(together.returns[i], alone.returns)


def test_a_task_without_physics_says_so(key):
    with pytest.raises(UsageError, match="no MuJoCo state"):
        run_episodes(untrained(PPO(**SMALL), 2, 1, key), Counter(), key, 1, physics=True)


@pytest.mark.parametrize("name", ["toy/turkey", "dmc/cheetah_run", "brax/ant"])
def test_gymnasium_has_its_own_tasks_alone(name, policy, key):
    with pytest.raises(UsageError, match=f"Gymnasium has no environment '{name}'"):
        run_in_gymnasium(policy, {"name": name}, key, 1)


@pytest.mark.parametrize("ours", [{"hide_velocities": True}, {"action_repeat": 2}])
def test_gymnasium_has_no_keywords_of_ours(ours, policy, key):
    with pytest.raises(UsageError, match=f"Gymnasium has no {next(iter(ours))}; use --engine"):
        run_in_gymnasium(policy, PENDULUM | ours, key, 1)
