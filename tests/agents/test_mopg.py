"""MOPG's targets and loss against their definitions, written as plain loops."""

import functools

import distrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOPG
from hitmdp_jax.errors import UsageError
from hitmdp_jax.networks import OptionEncoder
from tests.agents.compiled import Compiled
from tests.agents.option_batches import SMALL, B, K, T, flatten, random_batch
from tests.learning.test_advantages import advantages_by_loop
from tests.programs import compiled

AGENT = MOPG(switching_cost=0.0, usage_weight=0.0, **SMALL)


@pytest.fixture
def batch():
    batch = random_batch()
    return batch.replace(memory=batch.memory.previous)


def master(agent, params, obs, previous):
    """P(o | s, o_{t-1}) of one state, straight from the encoder."""
    scale = agent.embedding_size**-0.5
    encoder = OptionEncoder(agent.master_policy, agent.hidden_sizes, input_scale=scale)
    return master_of(encoder, params, obs, previous, agent.similarity)


@functools.partial(compiled, static_argnums=0)
def master_of(encoder, params, obs, previous, similarity):
    logits = encoder.apply(
        {"params": params["encoder"]}, obs[None], previous[None], params["embeddings"], similarity
    )
    return jax.nn.softmax(logits[0])


def of_every_option(function):
    """Return function(agent, params, option, ...) [K], one option at a time."""
    return compiled(
        lambda agent, params, *rest: jnp.stack(
            [function(agent, params, jnp.array([o]), *rest)[0] for o in range(K)]
        )
    )


each_q = of_every_option(lambda agent, params, option, obs: agent.q(params, obs[None], option))
each_density = of_every_option(
    lambda agent, params, option, obs, action: jnp.exp(
        agent.policy(params, obs[None], option).log_prob(action[None])
    )
)


def q_values(agent, params, obs):
    """Q_O[s, o] of one state and every option."""
    return each_q(agent.agent, params, obs)


def v_bar(agent, params, obs, previous):
    """Eq. 6."""
    return float(master(agent, params, obs, previous) @ q_values(agent, params, obs))


@pytest.mark.parametrize("form", ["similarity", "printed"])
def test_both_advantages_equal_their_definitions(form, params, batch):
    agent = Compiled(
        MOPG(
            master_policy=form,
            entropy_weight=0.1,
            mutual_information="action",
            information_weight=0.3,
            **SMALL,
        )
    )
    data, _ = agent.targets(params, batch)
    log_option = agent.option_log_probs(params, batch.obs, batch.memory)
    information = 0.3 * np.asarray(agent.information(params, batch, log_option))
    value, value_next, q, q_next, for_choice = np.zeros((5, T, B))
    action_entropy = np.sum(params["decoder"]["log_std"] + 0.5 * np.log(2 * np.pi * np.e))

    def soft_value(obs, previous):
        probabilities = np.asarray(master(agent, params, obs, previous))
        option_entropy = -0.1 * np.sum(probabilities * np.log(probabilities))
        return v_bar(agent, params, obs, previous) + option_entropy, option_entropy

    for t in range(T):
        for b in range(B):
            obs, next_obs = batch.obs[t, b], batch.next_obs[t, b]
            previous, option = batch.memory[t, b], batch.record[t, b]
            value[t, b], option_entropy = soft_value(obs, previous)
            value_next[t, b], entropy_next = soft_value(next_obs, option)
            q[t, b] = q_values(agent, params, obs)[option]
            for_choice[t, b] = information[t, b] + option_entropy
            if batch.terminated[t, b] or batch.truncated[t, b] or t == T - 1:
                q_next[t, b] = value_next[t, b]
            else:
                drawn = q_values(agent, params, next_obs)[batch.record[t + 1, b]]
                q_next[t, b] = drawn + entropy_next + information[t + 1, b]
    ends = batch.terminated, batch.truncated
    reward = batch.reward + 0.1 * action_entropy
    of_option = advantages_by_loop(reward + for_choice, value, value_next, *ends, 0.99, 0.95, True)
    of_action = advantages_by_loop(reward, q, q_next, *ends, 0.99, 0.95, True)
    np.testing.assert_allclose(data["value_target"], of_action + q, rtol=1e-3, atol=1e-3)
    for name, advantage in ("option", of_option), ("action", of_action + information):
        standardized = (advantage - advantage.mean()) / advantage.std()
        np.testing.assert_allclose(data[f"advantage_{name}"], standardized, rtol=1e-3, atol=1e-3)
        weight = np.full((T, B), 0.1 / advantage.std())
        np.testing.assert_allclose(data[f"entropy_weight_{name}"], weight, rtol=1e-3)


def test_information_equals_brute_force(params, batch):
    agent = Compiled(MOPG(mutual_information="action", **SMALL))
    log_option = agent.option_log_probs(params, batch.obs, batch.memory)
    result = agent.information(params, batch, log_option)
    for t, b in np.ndindex(T, B):
        obs, option = batch.obs[t, b], batch.record[t, b]
        density = each_density(agent.agent, params, obs, batch.action[t, b])
        marginal = master(agent, params, obs, batch.memory[t, b]) @ density
        np.testing.assert_allclose(
            result[t, b], np.log(density[option] / marginal), rtol=1e-3, atol=1e-4
        )


def test_loss_at_the_old_policy_is_by_hand(agent, params, batch):
    data = flatten(agent.targets(params, batch)[0])
    q = agent.q(params, data["obs"], data["option"])
    data |= {
        "advantage_option": np.full(T * B, 2.0),
        "advantage_action": np.full(T * B, 3.0),
        "value_target": q - 2.0,
        "entropy_weight_option": np.full(T * B, 0.5),
    }
    loss, diagnostics = agent.loss(params, data)
    probabilities = np.asarray(agent.option_probs(params, batch.obs, batch.memory))
    entropy = -(probabilities * np.log(probabilities)).sum(axis=-1).mean()
    # Both ratios are 1: half of 2^2, in the critic's units, less 2, less 3, less half the entropy.
    units = params["critic"]["scale"] ** 2
    np.testing.assert_allclose(loss, 2.0 / units - 2.0 - 3.0 - 0.5 * entropy, rtol=1e-4)
    np.testing.assert_allclose(diagnostics["option_kl"], 0.0, atol=1e-6)


def test_gradient_at_the_old_policy_is_the_policy_gradient(agent, params, batch):
    """sum of A grad log pi over both policies (Thm 4.2, 4.3), by autodiff of the plain formula."""
    data = flatten(agent.targets(params, batch)[0])
    q = agent.q(params, data["obs"], data["option"])
    data["value_target"] = q  # leaves no critic gradient

    def plain(params):
        log_master = agent.option_log_probs(params, data["obs"], data["previous"])
        log_option = distrax.Categorical(log_master).log_prob(data["option"])
        policy = agent.policy(params, data["obs"], data["option"])
        log_action = policy.log_prob(data["action"])
        return -jnp.mean(
            data["advantage_option"] * log_option + data["advantage_action"] * log_action
        )

    @compiled
    def gradients(params):
        return jax.grad(lambda p: agent.loss(p, data)[0])(params), jax.grad(plain)(params)

    result, expected = gradients(params)
    for name in ("embeddings", "encoder", "decoder"):
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4),
            result[name],
            expected[name],
        )


def test_unknown_master_policy_is_explained():
    with pytest.raises(UsageError, match="did you mean 'printed'"):
        MOPG(master_policy="print")


def test_the_entropy_weight_is_annealed():
    agent = MOPG(entropy_weight=0.2, final_entropy_weight=0.1, entropy_schedule="linear")
    assert float(agent.scheduled(0.5).entropy_weight) == pytest.approx(0.15)
    constant = MOPG(entropy_weight=0.2).scheduled(0.5)
    assert float(constant.entropy_weight) == pytest.approx(0.2)


def test_usage_is_weighed_by_its_entropy(agent, params, batch):
    data = flatten(agent.targets(params, batch)[0])
    free, _ = agent.loss(params, data)
    even, _ = agent.replace(usage_weight=0.5).loss(params, data)
    probs = np.asarray(agent.option_probs(params, data["obs"], data["previous"])).mean(axis=0)
    np.testing.assert_allclose(free - even, -0.5 * (probs * np.log(probs)).sum(), rtol=1e-3)


def test_a_switching_cost_is_the_probability_to_leave_an_option(agent, params, batch):
    data = flatten(agent.targets(params, batch)[0])
    free, _ = agent.loss(params, data)
    costly, _ = agent.replace(switching_cost=0.5).loss(params, data)
    stay = agent.option_probs(params, data["obs"], data["previous"])
    leaving = 1.0 - np.take_along_axis(stay, data["previous"][..., None], axis=-1)
    np.testing.assert_allclose(costly - free, 0.5 * leaving.mean(), rtol=1e-3)
