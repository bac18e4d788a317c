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
from tests.theory import exact

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


ENTROPY = 0.3
PURE = {"switching_cost": 0.0, "usage_weight": 0.0}  # the ELBO alone
AGENT = TabularMOPG(num_options=K, gae_lambda=0.0, entropy_weight=ENTROPY, **PURE)
START = np.full((S, K), 1 / (S * K))


def soft(seed=0):
    """A random HiT-MDP whose entropies are rewarded."""
    return random_hit_mdp(seed, option_entropy=ENTROPY, action_entropy=ENTROPY)


def as_params(hit):
    """Softmax tables of both policies, and the exact Q_O in units of one."""
    return {
        "master": jnp.log(hit.master),
        "action": jnp.log(hit.action),
        "q": hidden_values(hit).q_option,
        "critic": {"scale": jnp.ones(())},
    }


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
def limit_of_many_samples(hit, start):
    """Every (s, o_prev, o, a) once, its advantages weighted by how often samples have it."""
    visited = (1 - hit.gamma) * occupancy(hit, start)
    joint = jnp.einsum("sp,spo,osa->spoa", visited, hit.master, hit.action)
    state, previous, option, action = (x.ravel() for x in jnp.indices(joint.shape))
    weight = joint.size * joint.ravel()
    params, values = as_params(hit), hidden_values(hit)
    information = jnp.broadcast_to(hit.information, joint.shape)
    advantage_option = (values.q_option[:, None] - values.v_bar[:, :, None])[..., None]
    advantage_action = (values.q_action - values.q_option[:, :, None])[:, None]
    return params, {
        "obs": jax.nn.one_hot(state, S, dtype=jnp.float64),
        "previous": previous,
        "memory": option,
        "option": option,
        "action": action,
        "log_prob_option": jax.nn.log_softmax(params["master"])[state, previous, option],
        "log_prob_action": jax.nn.log_softmax(params["action"])[option, state, action],
        "advantage_option": weight * (advantage_option + information).ravel(),
        "advantage_action": weight * (advantage_action + information).ravel(),
        "entropy_weight_option": weight * hit.option_entropy,
        "entropy_weight_action": weight * hit.action_entropy,
        "value_target": jnp.zeros(joint.size),
    }


@pytest.mark.parametrize("seed", range(3))
def test_mopg_loss_has_the_exact_gradient_in_the_limit_of_many_samples(seed):
    # of the ELBO with all its terms; an information that does not depend on the policies
    table = np.random.default_rng(seed).normal(size=(S, K, K, A))
    hit = dataclasses.replace(soft(seed), information=table)
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-8, atol=1e-10),
        surrogate_gradient(*limit_of_many_samples(hit, START)),
        exact_gradient(hit, START),
    )


def test_entropy_in_the_reward_lacks_the_gradient_of_the_entropy_at_hand():
    # With H(pi_O) and H(pi_A) in the values, the advantages carry what actions do to LATER
    # entropies. H of the step itself is a constant to the advantage, so its own gradient,
    # sum_s d(s) dH/dtheta, is missing from a surrogate without an entropy bonus.
    hit = soft()
    params, data = limit_of_many_samples(hit, START)
    none = {f"entropy_weight_{name}": 0.0 for name in ("option", "action")}
    gradient = surrogate_gradient(params, data | none)

    visited = (1 - hit.gamma) * exact.occupancy(hit, START)
    executed = np.einsum("sp,spo->so", visited, hit.master)

    def bonus(params):
        option_entropy = (visited * entropy(jax.nn.softmax(params["master"]))).sum()
        action_entropy = (executed.T * entropy(jax.nn.softmax(params["action"]))).sum()
        return ENTROPY * (option_entropy + action_entropy)

    policies = {name: params[name] for name in ("master", "action")}
    missing, whole = compiled(jax.grad(bonus))(policies), exact_gradient(hit, START)
    for name in ("master", "action"):
        np.testing.assert_allclose(gradient[name] + missing[name], whole[name], atol=1e-10)
        assert np.abs(missing[name]).max() > 1e-3


def test_mopg_targets_and_loss_estimate_the_exact_gradient_from_samples():
    # The agent's own targets (GAE of one step from the exact soft critic, standardised) on states
    # drawn from the discounted visits. Standardising divides both gradients by a deviation.
    hit, count = soft(), 800_000
    batch, params = draw_steps(hit, START, count), compiled(as_params)(hit)
    targets, _ = compiled(AGENT.targets)(params, batch)
    data = {name: x[0] for name, x in targets.items()}  # of the rollout's one step
    gradient, whole = surrogate_gradient(params, data), exact_gradient(hit, START)
    scale = {
        "master": raw_advantage(hit, batch, option=True).std(),
        "action": raw_advantage(hit, batch, option=False).std(),
    }
    for name in ("master", "action"):
        estimate = scale[name] * gradient[name]
        # |d log pi / d logit| <= 1 and |dH / d logit| < 1, which bounds the standard error.
        tolerance = 4 * (float(scale[name]) + ENTROPY) / np.sqrt(count)
        np.testing.assert_allclose(estimate, whole[name], rtol=0, atol=tolerance)
        assert tolerance < 0.25 * np.abs(whole[name]).max()


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
    earned = batch.reward[0] + hit.action_entropy * entropy(hit.action)[batch.record[0], state]
    earned += hit.gamma * values.v_bar[arriving]
    if option:
        return earned + hit.option_entropy * entropy(hit.master)[now] - values.v_bar[now]
    return earned - values.q_option[state, batch.record[0]]
