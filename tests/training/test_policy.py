"""What a trained policy answers: its actions, its options, what it expects."""

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOPG, PPO
from hitmdp_jax.envs.spec import Box, Discrete, Observation, Spec
from hitmdp_jax.export.program import program_of, to_stablehlo
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.training.policy import Decision
from tests.probes import Target, untrained_policy

NARROW = Spec(Observation((1,)), Box((-0.1,), (0.1,)), episode_length=10)
AGENT = MOPG(num_options=3, hidden_sizes=(8,))
OBS = jnp.linspace(-1.0, 1.0, 16)[:, None]


class Narrow(Target):
    """`Target` that says in which range it takes actions, and does not clip them."""

    spec = NARROW


@pytest.fixture(scope="module")
def policy():
    return untrained_policy(AGENT.bind(NARROW), jax.random.key(1))


def test_an_action_comes_with_its_option_and_unpacks_into_two(policy, key):
    memory = policy.initial_memory(key, (16,))
    decision = policy.act(OBS, memory, key)
    action, after = decision
    assert action is decision.action is decision[0]
    assert after is decision.memory is decision[1]
    assert len(decision) == 2
    drawn, _, option = policy.agent.act(policy.params, policy.normalized(OBS), memory, key)
    np.testing.assert_array_equal(decision.option, option)
    assert jnp.abs(drawn).max() > 0.1
    np.testing.assert_allclose(action, np.clip(drawn, -0.1, 0.1), rtol=1e-6)


def test_a_decision_is_a_pytree_that_goes_through_jit_and_vmap(policy, key):
    memory = policy.initial_memory(key, (16,))
    each = jax.jit(jax.vmap(lambda obs, memory: policy.act(obs, memory, key, True)))(OBS, memory)
    assert isinstance(each, Decision)
    together = policy.act(OBS, memory, key, deterministic=True)
    np.testing.assert_array_equal(each.option, together.option)
    np.testing.assert_allclose(each.action, together.action, atol=1e-6)


def test_an_episode_and_an_export_have_the_actions_that_act_returns(policy, key):
    recorded = run_episodes(policy, Narrow(), key, 16)
    assert jnp.abs(recorded.action).max() == pytest.approx(0.1)
    program = program_of(policy)
    memory = policy.initial_memory(key, (16,))
    content, _ = to_stablehlo(program)
    exported = jax.export.deserialize(bytearray(content)).call(OBS, memory)
    found = dict(zip(program.outputs, exported, strict=True))
    own = policy.act(OBS, memory, key, deterministic=True)
    np.testing.assert_allclose(found["action"], own.action, atol=1e-6)
    np.testing.assert_array_equal(found["option"], own.option)


def test_choices_are_returned_as_they_are(key):
    spec = Spec(Observation((1,)), Discrete(5))
    decision = untrained_policy(PPO().bind(spec), key).act(OBS, (), key)
    assert decision.option is None
    assert decision.action.dtype == jnp.int32
    assert set(decision.action.tolist()) <= set(range(5))


class Traced(PPO):
    """PPO that says each time that Python runs its code."""

    def act(self, *args, **kwargs):
        TRACES.append("act")
        return super().act(*args, **kwargs)

    def value_of(self, *args):
        TRACES.append("value")
        return super().value_of(*args)

    def option_probs(self, *args):
        TRACES.append("option_probs")


TRACES: list[str] = []


def test_what_a_policy_says_is_compiled_once_without_a_word(key):
    policy = untrained_policy(Traced(hidden_sizes=(8,)).bind(NARROW), key)
    for i in range(3):
        policy.act(OBS[i], (), jax.random.key(i))
        policy.value(OBS[i], ())
        assert policy.option_probs(OBS[i], ()) is None
    assert sorted(TRACES) == ["act", "option_probs", "value"]
