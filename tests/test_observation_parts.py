"""A task that shows two arrays by name, of which the policy reads one and the critic both."""

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State

import hitmdp_jax
from hitmdp_jax.agents import DAC, MOPG, PPO
from hitmdp_jax.errors import UsageError
from hitmdp_jax.export.program import export
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.interpret.evaluation import check_fit

SIZES = {"num_steps": 20 * 512, "num_envs": 16, "rollout_length": 32}
SMALL = {"hidden_sizes": (16,), "learning_rate": 0.01, "minibatch_size": 128}


class Guess:
    """Pays 1 - (a - x)^2 + y for action a, and shows x; y, drawn with x, is the critic's to know.

    Each episode is one step long. The best return is 1 in the mean.
    """

    action_size = 1
    episode_length = 10

    def reset(self, key):
        x, y = jax.random.uniform(key, (2, 1), minval=-1.0, maxval=1.0)
        obs = {"state": x, "privileged_state": jnp.concatenate([x, 3.0 * y])}
        return State(None, obs, jnp.zeros(()), jnp.zeros(()))

    def step(self, state, action):
        reward = 1.0 - jnp.square(action - state.obs["state"]) + state.obs["privileged_state"][1:]
        return state.replace(reward=reward[0], done=jnp.ones(()))


AGENTS = [
    pytest.param(PPO(action_reads=("state",), **SMALL), marks=pytest.mark.whole),
    MOPG(num_options=2, action_reads=("state",), master_reads=("state",), **SMALL),
    pytest.param(
        DAC(num_options=2, action_reads=("state",), master_reads=("state",), **SMALL),
        marks=pytest.mark.whole,
    ),
]


@pytest.mark.parametrize("agent", AGENTS, ids=lambda agent: type(agent).__name__)
def test_what_only_the_critic_reads_is_learned_from_saved_scored_and_exported(agent, tmp_path):
    env = Guess()
    state, metrics = jax.jit(lambda key: hitmdp_jax.train(agent, env, key, **SIZES))(
        jax.random.key(0)
    )
    assert not metrics["diverged"].any()
    assert metrics["episode_return"][-3:].mean() > 0.85
    # The critic sees y, which makes up most of the returns' spread; the policies cannot.
    assert metrics["value_loss"][-1] < 0.25
    hitmdp_jax.save(tmp_path / "run", agent, state)
    policy = hitmdp_jax.load(tmp_path / "run")
    assert policy.spec == hitmdp_jax.spec_of(env)
    check_fit(policy, env)
    recorded = run_episodes(policy, env, jax.random.key(1), 64, deterministic=True)
    assert recorded.returns.mean() > 0.6
    assert recorded.obs.shape == (10, 64, 3)
    key = jax.random.key(2)
    obs = jax.vmap(env.reset)(jax.random.split(key, 5)).obs
    memory = policy.initial_memory(key, (5,))
    action, _ = policy.act(obs, memory, key, deterministic=True)
    row = policy.spec.observation.flat(obs)
    np.testing.assert_array_equal(policy.act(row, memory, key, deterministic=True)[0], action)
    other = obs | {"privileged_state": obs["privileged_state"] + np.array([0.0, 1.0])}
    np.testing.assert_array_equal(policy.act(other, memory, key, deterministic=True)[0], action)
    assert (policy.value(other, memory) > policy.value(obs, memory)).all()
    content, contract = export(policy, "stablehlo")
    assert contract["observation_parts"] == [["privileged_state", [2]], ["state", [1]]]
    call = jax.export.deserialize(bytearray(content)).call
    np.testing.assert_allclose(call(row, *jax.tree.leaves(memory))[0], action, atol=1e-6)
    with pytest.raises(UsageError, match="obs lacks its part 'state'"):
        policy.act({"privileged_state": row[:, :2]}, memory, key)
    with pytest.raises(UsageError, match=r"obs\['state'\] has shape \(5, 2\)"):
        policy.act(obs | {"state": row[:, :2]}, memory, key)


def test_a_part_that_the_task_does_not_show_is_explained():
    with pytest.raises(UsageError, match="observation 'stat'; did you mean 'state'"):
        hitmdp_jax.make_train(PPO(action_reads=("stat",)), Guess(), num_steps=2048)
