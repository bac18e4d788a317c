"""The information terms against enumeration of the joint distribution they are defined by."""

import itertools

import numpy as np
import pytest
from scipy.special import log_softmax

from hitmdp_jax.learning import mutual_information
from tests.programs import compiled

action_information = compiled(mutual_information.action_information)

K = 3


@pytest.fixture
def case():
    """Random master policy P(o | s, o_prev) [N, K_prev, K], densities [N, K], options."""
    rng = np.random.default_rng(0)
    N = 7
    master = np.exp(log_softmax(rng.normal(size=(N, K, K)), axis=-1))
    density = rng.uniform(0.1, 3.0, size=(N, K))
    return master, density, rng.integers(K, size=N), rng.integers(K, size=N)


def test_action_information_equals_enumeration(case):
    master, density, previous, option = case
    result = action_information(np.log(master[np.arange(7), previous]), np.log(density), option)
    for n in range(7):
        marginal = sum(master[n, previous[n], o] * density[n, o] for o in range(K))
        expected = np.log(density[n, option[n]] / marginal)
        np.testing.assert_allclose(result[n], expected, rtol=1e-5)


def test_mean_action_information_is_not_negative():
    """Averaged over options and actions it is a mutual information."""
    rng = np.random.default_rng(1)
    master = np.exp(log_softmax(rng.normal(size=K)))
    policy = np.exp(log_softmax(rng.normal(size=(K, 5)), axis=-1))  # P(a | o) over 5 actions
    total = 0.0
    for o, a in itertools.product(range(K), range(5)):
        information = action_information(
            np.log(master)[None], np.log(policy[:, a])[None], np.array([o])
        )
        total += master[o] * policy[o, a] * float(information[0])
    assert total > 0


def test_information_vanishes_when_options_act_alike():
    log_master = np.log(np.full((4, K), 1 / K))
    log_action = np.full((4, K), -1.3)
    option = np.array([0, 1, 2, 0])
    np.testing.assert_allclose(action_information(log_master, log_action, option), 0, atol=1e-6)
