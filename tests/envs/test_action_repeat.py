"""Each action is held for several control steps, as a plain loop around Gymnasium holds it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax import make_env
from hitmdp_jax.agents import PPO
from hitmdp_jax.envs import check_env
from hitmdp_jax.envs.action_repeat import ActionRepeat
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import run_episodes
from tests.envs.suites.gym.oracle import GymnasiumTask
from tests.envs.suites.parity import assert_near, our_steps, random_actions, random_states
from tests.probes import Counter, untrained_policy

REPEAT, ACTIONS, STATES = 6, 3, 20


def held_in_gymnasium(oracle, qpos, qvel, actions):
    """Return (observation, reward, terminated, reward terms) of one episode [T], held by hand."""
    oracle.set_state(qpos, qvel)
    seen = []
    for action in actions:
        total, terms = 0.0, {"reward_forward": 0.0, "reward_survive": 0.0}
        for _ in range(REPEAT):
            obs, reward, terminated, info = oracle.step(action)
            total += reward
            terms = {name: terms[name] + info[name] for name in terms}
            if terminated:
                break
        seen.append((obs, total, terminated, terms))
        if terminated:
            break
    return seen


def test_rewards_add_up_as_in_a_loop_around_gymnasium_until_the_task_ends_the_episode():
    oracle = GymnasiumTask("hopper")
    env = make_env("hopper", physics="native", action_repeat=REPEAT)
    qpos, qvel = random_states(oracle, num_states=STATES)
    actions = random_actions(oracle, (ACTIONS, STATES), np.random.default_rng(1))
    ours = our_steps(env, qpos, qvel, actions)
    ended_amid_a_hold = 0
    for row in range(STATES):
        theirs = held_in_gymnasium(oracle, qpos[row], qvel[row], actions[:, row])
        for step, (obs, reward, terminated, terms) in enumerate(theirs):
            assert_near(ours.obs[step, row], obs, 2e-3, 1.0, "observation")
            np.testing.assert_allclose(ours.reward[step, row], reward, atol=5e-3)
            assert ours.terminated[step, row] == terminated
            for name, value in terms.items():
                np.testing.assert_allclose(ours.terms[name][step, row], value, atol=5e-3)
            healthy_steps = round(terms["reward_survive"])
            ended_amid_a_hold += terminated and 0 < healthy_steps < REPEAT - 1
    assert ended_amid_a_hold > 3  # so that what happens there was compared


@pytest.mark.parametrize(("repeat", "lengths"), [(2, [2, 2, 1]), (3, [3, 2]), (7, [5])])
def test_the_time_limit_is_in_control_steps_and_cuts_the_last_hold(key, repeat, lengths):
    env = VectorEnv(ActionRepeat(Counter(), repeat), 2, pool_size=8, stagger=False)
    state, step = env.reset(key), jax.jit(env.step)
    for episode in range(2):
        for taken, length in zip(lengths, np.cumsum(lengths), strict=True):
            state, seen = step(state, jnp.zeros((2, 1)))
            np.testing.assert_array_equal(seen.reward, taken)
            np.testing.assert_array_equal(seen.episode_length, length)
            np.testing.assert_array_equal(seen.next_obs[:, 0], length)
            np.testing.assert_array_equal(seen.started, length == lengths[0])
            np.testing.assert_array_equal(seen.truncated, length == Counter.episode_length)
            np.testing.assert_array_equal(seen.finished, seen.truncated)
        assert set(seen.episode_return.tolist()) == {5.0}, episode


def test_trajectories_are_as_long_as_their_control_steps(key):
    policy = untrained_policy(PPO(hidden_sizes=(8,), spec=spec_of(Counter())), key)
    recorded = run_episodes(policy, ActionRepeat(Counter(), 2), key, 3)
    np.testing.assert_array_equal(recorded.control_steps, [[2] * 3, [2] * 3, [1] * 3])
    np.testing.assert_array_equal(recorded.lengths, [5, 5, 5])
    np.testing.assert_array_equal(recorded.returns, [5, 5, 5])
    np.testing.assert_array_equal(recorded.obs[:, 0, 0], [0, 2, 4])


class Terms(Counter):
    """Reports terms that add up to its reward, n at step n, and writes over the state, as Brax."""

    reward_terms = ("a_bonus",)

    def reset(self, rng):
        names = ("reward_fast", "fast_reward", "reward/near", "a_bonus", "x_position")
        return super().reset(rng).replace(metrics=dict.fromkeys(names, jnp.zeros(())))

    def step(self, state, action):
        clock = state.obs[0] + 1.0
        terms = {"reward_fast": 2 * clock, "fast_reward": -clock, "reward/near": clock}
        state.metrics.update(terms, a_bonus=-clock, x_position=10 * clock)
        return super().step(state, action).replace(reward=clock)


@pytest.mark.parametrize("repeat", [1, 2, 3])
def test_the_reward_terms_of_any_task_add_up_to_its_reward(key, repeat):
    env = VectorEnv(ActionRepeat(Terms(), repeat), 2, pool_size=8, stagger=False)
    state, step = env.reset(key), jax.jit(env.step)
    for _ in range(2 * 5):  # across the time limit, which cuts a hold
        state, seen = step(state, jnp.zeros((2, 1)))
        last = np.asarray(seen.metrics["x_position"]) / 10
        np.testing.assert_array_equal(last, seen.episode_length)
        terms = [x for name, x in seen.metrics.items() if name != "x_position"]
        np.testing.assert_allclose(sum(terms), seen.reward)
        first = (last - 1) // repeat * repeat + 1
        np.testing.assert_allclose(seen.reward, (first + last) * (last - first + 1) / 2)


def test_control_steps_are_what_a_run_counts(key):
    agent = PPO(num_epochs=1, minibatch_size=8, hidden_sizes=(8,))
    sizes = {"num_envs": 2, "rollout_length": 8}
    env = ActionRepeat(Counter(), 4)
    run = jax.jit(lambda key: hitmdp_jax.train(agent, env, key, num_steps=256, **sizes)[1])
    metrics = run(key)
    assert metrics["episode_return"].shape == (256 // (4 * 2 * 8),)
    assert set(metrics["episode_length"].tolist()) == {5.0}
    np.testing.assert_array_equal(metrics["episode_return"], metrics["episode_length"])


def test_a_held_task_is_like_itself_but_for_its_steps():
    plain, held = (make_env("swimmer", physics="native", action_repeat=n) for n in (1, 5))
    assert not isinstance(plain, ActionRepeat)
    assert held.dt == 5 * plain.dt
    assert held.episode_length == plain.episode_length
    assert spec_of(held) == dataclasses.replace(spec_of(plain), dt=held.dt)
    assert (held.observation_size, held.action_size, held.backend) == (8, 2, "native")


@pytest.mark.parametrize("name", ["halfcheetah", "toy/turkey", "brax/ant"])
def test_every_task_can_be_held_and_says_what_is_wrong(name):
    check_env(name, action_repeat=2)
    for wrong in (0, -1, 1.5, "two", None, True):
        with pytest.raises(UsageError) as error:
            check_env(name, action_repeat=wrong)
        assert str(error.value) == f"action_repeat = {wrong} must be a positive whole number."


def test_a_task_that_makes_its_state_anew_can_be_held(key):
    # The turkey is stuffed by the first control step of the hold and not roasted by the second.
    env = make_env("toy/turkey", action_repeat=2)
    state = jax.jit(env.step)(env.reset(key), -jnp.ones(1))
    assert state.done
    assert state.reward == 0
