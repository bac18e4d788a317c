"""MOPG's targets and loss against their definitions, written as plain loops."""

import functools

import distrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOPG
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.networks import OptionEncoder
from tests.agents.compiled import Compiled
from tests.agents.option_batches import flatten, random_params
from tests.learning.test_advantages import advantages_by_loop

T, B, O, A, K = 5, 3, 4, 2, 4  # noqa: E741


@pytest.fixture
def params(key):
    # Larger policy heads, so that options and actions differ by more than rounding.
    return random_params(Compiled(MOPG()), key)


@pytest.fixture
def batch(key):
    return random_batch(key)


@jax.jit
def random_batch(key):
    keys = jax.random.split(key, 8)
    option = jax.random.randint(keys[0], (T, B), 0, K)
    first = jax.random.randint(keys[1], (1, B), 0, K)
    obs = jax.random.normal(keys[2], (T + 1, B, O))
    truncated = jnp.zeros((T, B), bool).at[1, 1].set(True)
    terminated = jnp.zeros((T, B), bool).at[2, 0].set(True)
    return Batch(
        obs=obs[:-1],
        next_obs=obs[1:],
        action=jax.random.normal(keys[3], (T, B, A)),
        memory=jnp.concatenate([first, option[:-1]]),
        record=option,
        reward=jax.random.normal(keys[4], (T, B)),
        terminated=terminated,
        truncated=truncated,
        started=jnp.zeros((T, B), bool),
    )


def master(agent, params, obs, previous):
    """P(o | s, o_{t-1}) of one state, straight from the encoder."""
    encoder = OptionEncoder(agent.master_policy, agent.hidden_sizes)
    return np.asarray(master_of(encoder, params, obs, previous, agent.similarity))


@functools.partial(jax.jit, static_argnums=0)
def master_of(encoder, params, obs, previous, similarity):
    logits = encoder.apply(
        {"params": params["encoder"]},
        obs[None],
        jnp.asarray(previous)[None],
        params["embeddings"],
        similarity,
    )
    return jax.nn.softmax(logits[0])


def q_values(agent, params, obs):
    """Q_O[s, o] of one state and every option."""
    return np.array([float(agent.q(params, obs[None], jnp.array([o]))[0]) for o in range(K)])


def v_bar(agent, params, obs, previous):
    """Eq. 6."""
    return float(master(agent, params, obs, previous) @ q_values(agent, params, obs))


@pytest.mark.parametrize("form", ["similarity", "printed"])
def test_both_advantages_equal_their_definitions(form, params, batch):
    agent = Compiled(MOPG(master_policy=form, entropy_weight=0.1))
    data, _ = agent.targets(params, batch)
    value, value_next, q, q_next = np.zeros((4, T, B))
    reward_option, reward_action = np.zeros((2, T, B))
    for t in range(T):
        for b in range(B):
            obs, next_obs = batch.obs[t, b], batch.next_obs[t, b]
            previous, option = int(batch.memory[t, b]), int(batch.record[t, b])
            probabilities = master(agent, params, obs, previous)
            value[t, b] = v_bar(agent, params, obs, previous)
            value_next[t, b] = v_bar(agent, params, next_obs, option)
            q[t, b] = q_values(agent, params, obs)[option]
            ended = batch.terminated[t, b] or batch.truncated[t, b] or t == T - 1
            q_next[t, b] = (
                value_next[t, b]
                if ended
                else q_values(agent, params, next_obs)[int(batch.record[t + 1, b])]
            )
            option_entropy = -np.sum(probabilities * np.log(probabilities))
            log_std = np.asarray(params["decoder"]["log_std"])
            action_entropy = np.sum(log_std + 0.5 * np.log(2 * np.pi * np.e))
            reward_option[t, b] = batch.reward[t, b] + 0.1 * option_entropy
            reward_action[t, b] = batch.reward[t, b] + 0.1 * action_entropy
    ends = np.asarray(batch.terminated), np.asarray(batch.truncated)
    for name, reward, v, v_next in (
        ("advantage_option", reward_option, value, value_next),
        ("advantage_action", reward_action, q, q_next),
    ):
        expected = advantages_by_loop(reward, v, v_next, *ends, 0.99, 0.95, True)
        standardized = (expected - expected.mean()) / expected.std()
        np.testing.assert_allclose(data[name], standardized, rtol=1e-3, atol=1e-3)
        if name == "advantage_action":
            np.testing.assert_allclose(data["q_target"], expected + q, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("choice", ["action", "usage", "previous"])
def test_information_equals_brute_force(choice, params, batch):
    agent = Compiled(MOPG(mutual_information=choice))
    log_option = agent.option_log_probs(params, batch.obs, batch.memory)
    result = agent.information(params, batch, log_option).ravel()
    flat = flatten(batch)
    N = T * B
    usage = np.bincount(np.asarray(flat.record), minlength=K) / N
    usage_before = np.bincount(np.asarray(flat.memory), minlength=K) / N
    for n in range(N):
        obs, option, previous = flat.obs[n], int(flat.record[n]), int(flat.memory[n])
        density = np.array(
            [
                np.exp(
                    float(
                        agent.policy(params, obs[None], jnp.array([o])).log_prob(
                            flat.action[n][None]
                        )[0]
                    )
                )
                for o in range(K)
            ]
        )
        every = np.stack([master(agent, params, obs, p) for p in range(K)])  # [K previous, K]
        posterior = every[previous] * density / (every[previous] @ density)
        marginal = (usage_before @ every) * density
        expected = {
            "action": np.log(density[option] / (every[previous] @ density)),
            "usage": np.log(posterior[option] / usage[option]),
            "previous": np.log(posterior[option] * marginal.sum() / marginal[option]),
        }[choice]
        np.testing.assert_allclose(result[n], expected, rtol=1e-3, atol=1e-4)


def test_loss_at_the_old_policy_is_by_hand(params, batch):
    agent = Compiled(MOPG())
    data, _ = agent.targets(params, batch)
    q = agent.q(params, data["obs"], data["option"])
    data |= {
        "advantage_option": jnp.full((T, B), 2.0),
        "advantage_action": jnp.full((T, B), 3.0),
        "q_target": q - 2.0,
    }
    loss, diagnostics = agent.loss(params, data)
    # Both ratios are 1: half of 2^2, less 2, less 3.
    np.testing.assert_allclose(loss, 2.0 - 2.0 - 3.0, rtol=1e-4)
    np.testing.assert_allclose(diagnostics["option_kl"], 0.0, atol=1e-6)


def test_gradient_at_the_old_policy_is_the_policy_gradient(params, batch):
    """sum of A grad log pi over both policies (Thm 4.2, 4.3), by autodiff of the plain formula."""
    agent = Compiled(MOPG())
    data, _ = agent.targets(params, batch)
    q = agent.q(params, data["obs"], data["option"])
    data["q_target"] = q  # leaves no critic gradient

    def plain(params):
        log_master = agent.option_log_probs(params, data["obs"], data["previous"])
        log_option = distrax.Categorical(log_master).log_prob(data["option"])
        policy = agent.policy(params, data["obs"], data["option"])
        log_action = policy.log_prob(data["action"])
        return -jnp.mean(
            data["advantage_option"] * log_option + data["advantage_action"] * log_action
        )

    expected = jax.jit(jax.grad(plain))(params)
    result = jax.jit(jax.grad(lambda p: agent.loss(p, data)[0]))(params)
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
    assert float(agent.scheduled(jnp.array(0.5)).entropy_weight) == pytest.approx(0.15)
    constant = MOPG(entropy_weight=0.2).scheduled(jnp.array(0.5))
    assert float(constant.entropy_weight) == pytest.approx(0.2)
