import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import AHP, IOPG, MOPG, PPO, Agent
from hitmdp_jax.agents.base import static
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.interpret.forced_options import force_options, number_of_options
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from tests.interpret.known_returns import Payment, obvious
from tests.probes import spec_of_sizes, untrained_policy
from tests.programs import compiled

SMALL = {"num_options": 3, "hidden_sizes": (8,), "spec": spec_of_sizes(2, 1)}


@pytest.mark.parametrize("agent", [MOPG(**SMALL), AHP(**SMALL), IOPG(**SMALL)], ids=type)
def test_a_schedule_of_its_own_choices_repeats_an_episode(agent, key):
    env = Payment()

    @compiled
    def run_twice(key):
        policy = untrained_policy(agent, key)
        own = run_episodes(policy, env, key, 4)
        return own, run_episodes(force_options(policy, own.option), env, key, 4)

    own, again = run_twice(key)
    assert len(np.unique(own.option)) > 1
    np.testing.assert_array_equal(again.option, own.option)
    np.testing.assert_allclose(again.action, own.action, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(again.reward, own.reward, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(again.option_probs, np.eye(3)[own.option])


def test_a_schedule_decides_and_starts_over(key):
    schedule = jnp.array([[2, 0], [1, 1], [0, 2]])
    recorded = jax.device_get(run_episodes(force_options(obvious(), schedule), Payment(), key, 2))
    np.testing.assert_array_equal(recorded.option.T, [[2, 1, 0, 2, 1, 0, 2], [0, 1, 2, 0, 1, 2, 0]])
    np.testing.assert_allclose(recorded.returns, [8, 6], atol=1e-4)


def test_a_single_policy_follows_a_single_schedule(key):
    policy = force_options(obvious(), jnp.array([2, 0]))
    act = jax.jit(functools.partial(policy.act, jnp.zeros(2)))
    memory, actions = policy.initial_memory(key), []
    for _ in range(3):
        action, memory = act(memory, key)
        actions.append(round(float(action[0])))
    assert actions == [2, 0, 2]


class NotTold(Agent):
    """Has options, and no policy to ask for under one of them."""

    num_options: int = static(2)
    init = act = update = None


@pytest.mark.parametrize("agent", [PPO(), NotTold()], ids=type)
def test_agents_without_options_say_so(agent):
    with pytest.raises(UsageError, match=f"{type(agent).__name__} has no options to look into"):
        number_of_options(agent)
    with pytest.raises(UsageError, match="no options"):
        force_options(Policy(agent, (), initial_statistics(2)), jnp.zeros(3, int))


def test_a_directed_agent_has_as_many_options():
    assert number_of_options(force_options(obvious(5), jnp.zeros(3, int)).agent) == 5
