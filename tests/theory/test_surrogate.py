"""The loss of `agents/mopg.py` with tabular policies, against the exact gradients."""

import dataclasses
import functools

import distrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOPG
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.theory import HiTMDP, hidden_values, objective, occupancy
from hitmdp_jax.theory.hit_mdp import entropy
from tests.programs import compiled

from .strategies import SHAPE, random_hit_mdp

S, K, A = SHAPE


class TabularMOPG(MOPG):
    """MOPG with tables for networks: observations are one-hot states, actions are indices."""

    def option_log_probs(self, params, obs, previous):
        return jax.nn.log_softmax(params["master"][obs.argmax(-1), previous])

    def policy(self, params, obs, option):
        return distrax.Categorical(logits=params["action"][option, obs.argmax(-1)])

    def q(self, params, obs, memory):
        return params["q"][obs.argmax(-1), memory]

    def every_q(self, params, obs, memory):
        return params["q"][obs.argmax(-1)]


solve = compiled(hidden_values)
visit = compiled(occupancy)
AGENT = TabularMOPG(num_options=K, gae_lambda=0.0)


def as_params(hit):
    """Softmax tables of both policies, and the exact Q_O in units of one."""
    return {
        "master": jnp.log(hit.master),
        "action": jnp.log(hit.action),
        "q": hidden_values(hit).q_option,
        "critic": {"scale": jnp.ones(())},
    }


params_of = compiled(as_params)


@compiled
def exact_gradient(hit, start):
    """(1 - gamma) dJ/d logits: the visits as probabilities."""

    def scaled(logits):
        master, action = jax.nn.softmax(logits["master"]), jax.nn.softmax(logits["action"])
        model = dataclasses.replace(hit, master=master, action=action)
        return (1 - hit.gamma) * objective(model, start)

    return jax.grad(scaled)({"master": jnp.log(hit.master), "action": jnp.log(hit.action)})


@compiled
def surrogate_gradient(params, data):
    """The gradient that MOPG ascends, of the policies alone."""
    gradient = jax.grad(lambda p: -AGENT.loss(p, data)[0])(params)
    return {name: gradient[name] for name in ("master", "action")}


@compiled
def limit_of_many_samples(hit, start, advantage_option, advantage_action):
    """Every (s, o_prev, o, a) once, its advantages weighted by how often samples have it."""
    visited = (1 - hit.gamma) * occupancy(hit, start)
    joint = jnp.einsum("sp,spo,osa->spoa", visited, hit.master, hit.action)
    state, previous, option, action = (x.ravel() for x in jnp.indices(joint.shape))
    weight = joint.size * joint.ravel()
    params = as_params(hit)
    return params, {
        "obs": jax.nn.one_hot(state, S, dtype=jnp.float64),
        "previous": previous,
        "memory": option,
        "option": option,
        "action": action,
        "log_prob_option": jax.nn.log_softmax(params["master"])[state, previous, option],
        "log_prob_action": jax.nn.log_softmax(params["action"])[option, state, action],
        "advantage_option": weight * jnp.broadcast_to(advantage_option, joint.shape).ravel(),
        "advantage_action": weight * jnp.broadcast_to(advantage_action, joint.shape).ravel(),
        "value_target": jnp.zeros(joint.size),
    }


@pytest.mark.parametrize("seed", range(3))
def test_mopg_loss_has_the_exact_gradient_in_the_limit_of_many_samples(seed):
    hit, start = random_hit_mdp(seed), np.full((S, K), 1 / (S * K))
    values = solve(hit)
    option = (values.q_option[:, None] - values.v_bar[:, :, None])[..., None]  # A^O
    action = (values.q_action - values.q_option[:, :, None])[:, None]  # A^A
    gradient = surrogate_gradient(*limit_of_many_samples(hit, start, option, action))
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-8, atol=1e-10),
        gradient,
        exact_gradient(hit, start),
    )


def test_entropy_in_the_reward_lacks_the_gradient_of_the_entropy_at_hand():
    # With H(pi_O) and H(pi_A) in the values, the advantages carry what actions do to LATER
    # entropies. H of the step itself is a constant to the advantage, so its own gradient,
    # sum_s d(s) dH/dtheta, is missing from a surrogate without an entropy bonus.
    hit = random_hit_mdp(option_entropy=0.3, action_entropy=0.3)
    start = np.full((S, K), 1 / (S * K))
    values = solve(hit)
    option = (values.q_option[:, None] - values.v_bar[:, :, None])[..., None]
    action = (values.q_action - values.q_option[:, :, None])[:, None]
    gradient = surrogate_gradient(*limit_of_many_samples(hit, start, option, action))

    visited = (1 - hit.gamma) * visit(hit, start)
    executed = np.einsum("sp,spo->so", visited, hit.master)

    def bonus(params):
        option_entropy = (visited * entropy(jax.nn.softmax(params["master"]))).sum()
        action_entropy = (executed.T * entropy(jax.nn.softmax(params["action"]))).sum()
        return 0.3 * (option_entropy + action_entropy)

    policies = {name: params_of(hit)[name] for name in ("master", "action")}
    missing, exact = compiled(jax.grad(bonus))(policies), exact_gradient(hit, start)
    for name in ("master", "action"):
        np.testing.assert_allclose(gradient[name] + missing[name], exact[name], atol=1e-10)
        assert np.abs(missing[name]).max() > 1e-3


def test_mopg_targets_and_loss_estimate_the_exact_gradient_from_samples():
    # The agent's own targets (GAE of one step from the exact critic, standardised) on states drawn
    # from the discounted visits. Standardising divides both gradients by a standard deviation.
    hit, start = random_hit_mdp(), np.full((S, K), 1 / (S * K))
    batch, count = draw_steps(hit, start, 200_000), 200_000
    params = params_of(hit)
    data, _ = compiled(AGENT.targets)(params, batch)
    gradient, exact = surrogate_gradient(params, data), exact_gradient(hit, start)
    scale = {
        "master": raw_advantage(hit, batch, option=True).std(),
        "action": raw_advantage(hit, batch, option=False).std(),
    }
    for name in ("master", "action"):
        estimate = scale[name] * gradient[name]
        # |d log pi / d logit| <= 1, so the standard error is below std(A) / sqrt(N)
        tolerance = 4 * float(scale[name]) / np.sqrt(count)
        np.testing.assert_allclose(estimate, exact[name], rtol=0, atol=tolerance)
        assert tolerance < 0.25 * np.abs(exact[name]).max()


@functools.partial(compiled, static_argnames="count")
def draw_steps(hit: HiTMDP, start, count, seed=0) -> Batch:
    """Draw single steps [1, count] from the discounted visits."""
    visited = (1 - hit.gamma) * occupancy(hit, start)
    keys = jax.random.split(jax.random.key(seed), 4)

    def draw(key, probabilities):
        return jax.random.categorical(key, jnp.log(probabilities))

    pair = jax.random.categorical(keys[0], jnp.log(visited.ravel()), shape=(count,))
    state, previous = pair // K, pair % K
    option = draw(keys[1], hit.master[state, previous])
    action = draw(keys[2], hit.action[option, state])
    following = draw(keys[3], hit.transition[state, action])
    nothing = jnp.zeros((1, count), bool)
    return Batch(
        obs=jax.nn.one_hot(state, S, dtype=jnp.float64)[None],
        next_obs=jax.nn.one_hot(following, S, dtype=jnp.float64)[None],
        action=action[None],
        memory=previous[None],
        record=option[None],
        reward=hit.reward[state, action][None],
        terminated=nothing,
        truncated=nothing,
        started=nothing,
    )


@functools.partial(compiled, static_argnames="option")
def raw_advantage(hit, batch, option):
    """The one-step advantages before they are standardised."""
    values = hidden_values(hit)
    state, following = batch.obs[0].argmax(-1), batch.next_obs[0].argmax(-1)
    now, arriving = (state, batch.memory[0]), (following, batch.record[0])
    baseline = values.v_bar[now] if option else values.q_option[state, batch.record[0]]
    return batch.reward[0] + hit.gamma * values.v_bar[arriving] - baseline
