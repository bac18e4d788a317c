"""Soft actor-critic on options: its targets against a loop, its master, and SAC as one option."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import log_softmax, logsumexp, rel_entr

from hitmdp_jax.agents import SAC, HitSAC
from tests.agents.option_batches import A, B, O, T, random_batch, random_params
from tests.probes import spec_of_sizes
from tests.programs import compiled

K = 3
SMALL = {"hidden_sizes": (8,), "batch_size": 8, "replay_size": 32, "warmup_steps": 8}
AGENT = HitSAC(num_options=K, gamma=0.9, stay=0.7, spec=spec_of_sizes(O, A), **SMALL)
MASTERS = ("best", "clustering")


def moderate(agent):
    """Random parameters whose actions are well within the range."""
    params = random_params(agent)
    small = {x: jax.tree.map(lambda x: 0.3 * x, params[x]) for x in ("actor", "critic_0")}
    return params | small


def rollout(num_options=K):
    batch = random_batch()
    option = batch.record % num_options
    action = np.clip(batch.action, -1, 1)
    return batch.replace(record=option, memory=batch.memory.previous % num_options, action=action)


def prior(stay=0.7):
    return np.where(np.eye(K, dtype=bool), stay, (1 - stay) / (K - 1))


def steps(agent, batch):
    replay = agent.store(agent.init_replay(agent.spec), batch)
    return jax.tree.map(lambda x: x[: T * B], replay.data)


@pytest.mark.parametrize("learners", ["executed", "every"])
@pytest.mark.parametrize("master", MASTERS)
def test_targets_are_those_of_a_loop(master, learners):
    """The sum over options is exact, for each option of before; o_{t-1} is not in the replay."""
    agent, batch = AGENT.replace(master=master, learners=learners), rollout()
    params = moderate(agent)
    target = jax.tree.map(lambda x: -0.5 * x, {x: params[x] for x in ("critic_0", "critic_1")})

    @compiled
    def run(params, target):
        step, key = steps(agent, batch), jax.random.key(5)
        _, _, option = agent.learned_options(step)
        found = agent.q_target(params, params | target, step, key, *option)
        action, log_prob = agent.draw(params, step.next_obs[:, None], key, jnp.arange(K))
        q = agent.network().apply(
            {"params": params | target}, step.next_obs[:, None], action, jnp.arange(K), method="q"
        )
        network = [
            agent._apply(params, "encoded", step.next_obs, jnp.full(T * B, k)) for k in range(K)
        ]
        return found, option[0], log_prob, q, jnp.stack(network, 1)

    found, option, log_prob, q, network = run(params, target)
    temperature, weight = np.exp(params["log_temperature"]), np.exp(params["log_option_weight"])
    assert found.shape == (T * B, K if learners == "every" else 1)
    for n in range(T * B):
        t, b = divmod(n, B)
        every = [min(q[0, n, k], q[1, n, k]) - temperature * log_prob[n, k] for k in range(K)]
        for place, before in enumerate(option[n]):
            assert before == (place if learners == "every" else batch.record[t, b])
            log_prior = np.log(prior()[before])
            if master == "best":
                chances = np.exp(log_softmax(log_prior + np.array(every) / weight))
            else:
                chances = np.exp(network[n, before])
            value = 0.0
            for k in range(K):
                cost = np.log(chances[k]) - log_prior[k]
                value += chances[k] * (every[k] - weight * cost)
            expected = batch.reward[t, b] + 0.9 * (0.0 if batch.terminated[t, b] else value)
            np.testing.assert_allclose(found[n, place], expected, rtol=1e-3, atol=1e-3)


def test_with_the_best_master_the_value_is_a_soft_maximum_under_the_prior():
    """V = alpha log sum_o p exp(Q / alpha): no other master is worth more."""
    q = np.random.default_rng(0).normal(size=(5, 1, K)).astype(np.float32)
    agent, weight = AGENT, np.exp(0.7)
    params = {"log_option_weight": np.float32(0.7)}

    @compiled
    def run(q):
        log_option = agent.master_log_probs(params, None, q, jnp.arange(K))
        return log_option, agent.soft_value(params, None, q, jnp.arange(K))

    log_option, value = run(q)
    np.testing.assert_allclose(
        value, weight * logsumexp(np.log(prior()) + q / weight, axis=-1), rtol=1e-5
    )
    for seed in range(5):
        other = np.random.default_rng(seed).dirichlet(np.ones(K), size=(5, K))
        worth = (other * q).sum(-1) - weight * rel_entr(other, prior()).sum(-1)
        assert (worth <= value + 1e-6).all()
    np.testing.assert_allclose(np.exp(log_option).sum(-1), 1.0, rtol=1e-5)


def test_under_the_uniform_prior_the_best_master_forgets_the_option_before():
    params, obs = moderate(AGENT), np.random.default_rng(0).normal(size=(4, 1, O))

    @compiled
    def run(agent, params):
        return agent.option_probs(params, obs.astype(np.float32), jnp.arange(K))

    uniform, sticky = (run(AGENT.replace(stay=stay), params) for stay in (1 / K, 0.7))
    np.testing.assert_allclose(uniform, uniform[:, :1].repeat(K, 1), rtol=1e-4)
    odds = np.log(sticky) - np.log(uniform)  # which are the prior's, whatever the state is
    odds -= odds[..., :1]
    expected = np.log(prior()) - np.log(prior()[:, :1])
    np.testing.assert_allclose(odds, np.broadcast_to(expected, odds.shape), atol=1e-3)


def test_the_master_networks_direction_is_the_gradient_of_the_value():
    """It climbs V(s', o_{t-1}) for every o_{t-1}, in units of alpha_O, and moves nothing else."""
    agent, batch = AGENT.replace(master="clustering"), rollout()
    params = moderate(agent)
    target = {x: params[x] for x in ("critic_0", "critic_1")}

    @compiled
    def run(params):
        step = steps(agent, batch)
        data = {"step": step, "target": target, "key": jax.random.key(3)}
        key_target, _ = jax.random.split(data["key"])
        q = agent.every_soft_q(params, step.next_obs, key_target)[:, None]

        def worth(part):
            known = params | part
            value = agent.soft_value(known, step.next_obs[:, None], q, jnp.arange(K))
            return -value.mean() / agent.option_weight(params)

        whole = jax.grad(lambda params: agent.loss(params, data)[0])(params)
        of_rest = jax.grad(lambda params: SAC.loss(agent, params, data)[0])(params)
        return whole, of_rest, jax.grad(worth)({"encoder": params["encoder"]})

    whole, of_rest, expected = run(params)
    scale = max(float(np.abs(x).max()) for x in jax.tree.leaves(expected))
    assert scale > 1e-3
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, atol=1e-4 * scale),
        whole["encoder"],
        expected["encoder"],
    )
    for part in ("actor", "critic_0", "critic_1", "log_temperature"):
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-4, atol=1e-5),
            whole[part],
            of_rest[part],
        )


OTHERWISE = pytest.param({"master": "clustering", "learners": "every"}, marks=pytest.mark.whole)


@pytest.mark.parametrize("how", [{"master": "best"}, OTHERWISE])
def test_with_one_option_an_update_is_sacs(how):
    alike = {"gamma": 0.9, "spec": spec_of_sizes(O, A), "layer_norm": True, **SMALL}
    batch, found = rollout(1), []
    for agent in (SAC(**alike), HitSAC(num_options=1, **how, **alike)):
        one = batch if isinstance(agent, HitSAC) else batch.replace(record=(), memory=())

        @compiled
        def run(key, agent=agent, one=one):
            state = agent.init(key, agent.spec)
            replay = agent.store(agent.init_replay(agent.spec), one)
            return agent.update(state, one.replace(replay=replay), key)

        found.append(run(jax.random.key(0)))
    (sac, of_sac), (hit, of_hit) = found
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, atol=1e-6), sac, hit)
    for name, value in of_sac.items():
        np.testing.assert_allclose(of_hit[name], value, rtol=1e-5)


@pytest.mark.parametrize("divergence", [0.0, 3.0])
def test_the_price_of_leaving_the_prior_rises_where_the_master_leaves_it_too_much(divergence):
    agent, batch = AGENT.replace(prior_divergence=divergence), rollout()
    params = moderate(agent)

    @compiled
    def slope(params):
        step = steps(agent, batch)
        target = {x: params[x] for x in ("critic_0", "critic_1")}
        data = {"step": step, "target": target, "key": jax.random.key(3)}
        key_target, _ = jax.random.split(data["key"])
        q = agent.every_soft_q(params, step.next_obs, key_target)
        log_option = agent.master_log_probs(params, None, q, step.record)
        gradient = jax.grad(lambda params: agent.loss(params, data)[0])(params)
        return gradient["log_option_weight"], jnp.exp(log_option)

    found, chances = slope(params)
    kl = rel_entr(chances, prior()[batch.record.reshape(-1)]).sum(-1).mean()
    assert 0.0 < kl < 3.0
    np.testing.assert_allclose(found, divergence - kl, rtol=1e-3)
