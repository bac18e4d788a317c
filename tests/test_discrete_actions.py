"""A task of choices and of a table for an observation, from training to an exported program."""

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

import hitmdp_jax
from hitmdp_jax.agents import DAC, IOPG, MOPG, PPO
from hitmdp_jax.envs.spec import Discrete, Observation, Spec
from hitmdp_jax.export.program import export
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.interpret.evaluation import check_fit
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.report.interactive import explorer
from tests.probes import untrained_policy

SIZES = {"num_steps": 4 * 512, "num_envs": 16, "rollout_length": 32}
SMALL = {"hidden_sizes": (16,), "learning_rate": 0.02}


class Corridor:
    """A walk on five cells, shown as a table [5, 2] of where one is and what the goal is.

    Choice 2 goes right, 0 left, 1 stays. Each step in the last cell pays 1; there are 8 steps,
    so the best return is 5.
    """

    spec = Spec(Observation((5, 2)), Discrete(3, ("left", "stay", "right")), episode_length=8)

    def reset(self, key):
        zero = jnp.zeros(())
        return State(None, self._seen(0), zero, zero, info={"cell": jnp.zeros((), jnp.int32)})

    def step(self, state, action):
        cell = jnp.clip(state.info["cell"] + action - 1, 0, 4)
        reward = (cell == 4).astype(float)
        return state.replace(obs=self._seen(cell), reward=reward, info={"cell": cell})

    def _seen(self, cell):
        return jnp.stack([jax.nn.one_hot(cell, 5), jax.nn.one_hot(4, 5)], axis=1)


AGENTS = [
    PPO(minibatch_size=128, **SMALL),
    MOPG(minibatch_size=128, num_options=2, mutual_information="action", **SMALL),
    pytest.param(DAC(minibatch_size=128, num_options=2, **SMALL), marks=pytest.mark.whole),
    pytest.param(IOPG(num_options=2, **SMALL), marks=pytest.mark.whole),
]


@pytest.mark.parametrize("agent", AGENTS, ids=lambda agent: type(agent).__name__)
def test_a_task_of_choices_is_learned_saved_scored_and_exported(agent, tmp_path):
    env = Corridor()
    train = jax.jit(lambda key: hitmdp_jax.train(agent, env, key, **SIZES))
    state, metrics = train(jax.random.key(0))
    assert not metrics["diverged"].any()
    returns = metrics["recent_return"]
    assert returns[-1] > returns[0]
    hitmdp_jax.save(tmp_path / "run", agent, state)
    policy = hitmdp_jax.load(tmp_path / "run")
    assert policy.spec == env.spec == hitmdp_jax.spec_of(env)
    check_fit(policy, env)
    returns = run_episodes(policy, env, jax.random.key(1), 16).returns
    assert 0 <= returns.min() < returns.max() <= 5
    content, contract = export(policy, "stablehlo")
    assert contract["action_names"] == ["left", "stay", "right"]
    key = jax.random.key(2)
    obs, memory = jnp.stack([env.reset(key).obs] * 3), policy.initial_memory(key, (3,))
    action, _ = policy.act(obs, memory, key, deterministic=True)
    call = jax.export.deserialize(bytearray(content)).call
    found = dict(
        zip(
            [x["name"] for x in contract["outputs"]],
            call(obs, *jax.tree.leaves(memory)),
            strict=True,
        )
    )
    np.testing.assert_array_equal(found["action"], action)
    np.testing.assert_array_equal(found["action_logits"].argmax(-1), action)
    assert ("option_logits" in found) == hasattr(agent, "num_options")


def test_what_options_do_to_choices_is_told():
    """Divergence is of the choices, and perturbations move their log-probabilities."""
    env = Corridor()
    agent = MOPG(num_options=2, embedding_size=3, hidden_sizes=(8,), spec=env.spec)
    policy = jax.jit(lambda key: untrained_policy(agent, key))(jax.random.key(0))
    found = OptionAnalysis(policy, env, jax.random.key(1), 3)
    every = agent.every_policy(policy.params, policy.normalized(found.states.obs))
    first, second = np.moveaxis(np.asarray(every.logits), 1, 0)
    apart = ((np.exp(first) - np.exp(second)) * (first - second)).sum(-1).mean() / 2
    expected = [[0, apart], [apart, 0]]
    np.testing.assert_allclose(found.divergence, expected, rtol=1e-2, atol=1e-7)
    assert found.perturbation.actions.shape == (2, 3, 21, 3)
    unmoved = found.perturbation.actions[:, 0, 10]
    np.testing.assert_allclose(unmoved, [first.mean(0), second.mean(0)], rtol=1e-3)
    np.testing.assert_array_equal(found.perturbation.noise, 1.0)
    assert found.perturbation.quantity == "log-probability"
    page = explorer(found)
    assert "the log-probability of each action" in page
    assert "mean action" not in page
