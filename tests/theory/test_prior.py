"""A prior over options that is not uniform: the ELBO that it gives, and the best master policy."""

import numpy as np
import pytest
from hypothesis import given
from scipy.special import rel_entr, softmax

from hitmdp_jax.learning.options import kl_to_prior, log_sticky
from tests.programs import compiled
from tests.theory import exact

from .strategies import TINY, distributions, few, hit_mdps, random_hit_mdp, with_start

T = 2
S, K, A = TINY


@few
@given(
    with_start(hit_mdps(TINY, interior=False), interior=True), distributions(K, K, interior=True)
)
def test_the_elbo_under_a_prior_is_a_soft_return_with_its_logarithm(drawn, prior):
    hit, start = drawn
    result = exact.evidence(hit, start, T, prior)
    np.testing.assert_allclose(result.log_evidence, result.elbo + result.kl, rtol=1e-12, atol=1e-12)
    constant = T * (np.log(A) + hit.reward.max() + hit.information.max())
    np.testing.assert_allclose(
        exact.elbo_objective(exact.with_prior(hit, prior), start, T) - constant,
        result.elbo,
        rtol=0,
        atol=1e-11,
    )


def test_the_prior_of_the_paper_is_the_uniform_one():
    hit, start = random_hit_mdp(shape=TINY), np.full((S, K), 1 / (S * K))
    uniform = exact.evidence(hit, start, T, np.full((K, K), 1 / K))
    printed = exact.evidence(hit, start, T)
    np.testing.assert_allclose(uniform.elbo, printed.elbo, rtol=1e-12)
    np.testing.assert_allclose(uniform.log_evidence, printed.log_evidence, rtol=1e-12)


@pytest.mark.parametrize("stay", [0.5, 0.9])
def test_the_best_master_policy_is_the_prior_tilted_by_the_values(stay):
    hit = random_hit_mdp(3, option_entropy=0.7)
    num_options = hit.master.shape[-1]
    prior = np.asarray(exact.sticky_prior(num_options, stay))
    # The entropy's weight is the prior's, too: weight (log p + H) = -weight KL.
    weighted = exact.with_prior(hit, prior**0.7)
    best, _ = exact.policy_iteration(weighted, 60)
    values = exact.hidden_values(best)
    np.testing.assert_allclose(
        exact.best_master(values.q_option, prior, 0.7), best.master, atol=1e-9
    )
    # It depends on the option before, by the prior's odds alone.
    odds = best.master / best.master[:, :1]
    np.testing.assert_allclose(
        odds / odds.sum(-1, keepdims=True),
        np.broadcast_to(
            (prior / prior[:1]) / (prior / prior[:1]).sum(-1, keepdims=True), odds.shape
        ),
        atol=1e-9,
    )


def test_under_the_uniform_prior_the_best_master_policy_forgets_the_option():
    q_option, uniform = np.random.default_rng(0).normal(size=(3, 4)), np.full((4, 4), 0.25)
    best = exact.best_master(q_option, uniform, 0.5)
    np.testing.assert_allclose(best, softmax(q_option / 0.5, -1)[:, None].repeat(4, 1), rtol=1e-9)


@pytest.mark.parametrize("num_options", [1, 2, 4])
def test_what_mopg_pays_is_the_divergence_from_that_prior(num_options):
    previous = np.arange(num_options)
    prior = np.asarray(exact.sticky_prior(num_options, 0.9 if num_options > 1 else 1.0))
    log_prior = compiled(log_sticky, static_argnums=1)(previous, num_options, 0.9)
    np.testing.assert_allclose(np.exp(log_prior), prior, rtol=1e-6)
    policy = np.random.default_rng(0).dirichlet(np.ones(num_options), size=num_options)
    np.testing.assert_allclose(
        compiled(kl_to_prior)(np.log(policy), log_prior), rel_entr(policy, prior).sum(-1), atol=1e-6
    )
