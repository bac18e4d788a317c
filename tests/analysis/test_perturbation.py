import jax
import numpy as np
import pytest

from hitmdp_jax.agents import DAC, MOPG
from hitmdp_jax.analysis.perturbation import SHIFTS, perturb, sentences, strongest
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.training.policy import Policy
from tests.programs import compiled

STATES = np.random.default_rng(0).normal(size=(6, 5)).astype(np.float32)


def untrained(agent, key):
    params = agent.init(key, 5, 2).params
    if "decoder" in params:  # a first policy hardly moves
        decoder = params["decoder"]
        params = params | {
            "decoder": decoder | {"mean": jax.tree.map(lambda x: 50 * x, decoder["mean"])}
        }
    return Policy(agent, params, initial_statistics(5))


@pytest.fixture(scope="module", params=["equal", "normal"])
def case(request):
    agent = MOPG(
        num_options=3, embedding_size=4, hidden_sizes=(8,), activation="tanh",
        embeddings=request.param, option_scale=1.0,
    )  # fmt: skip
    policy = jax.jit(lambda key: untrained(agent, key))(jax.random.key(0))
    return policy, perturb(policy, STATES)


def test_the_shifts_are_the_papers():
    np.testing.assert_allclose(SHIFTS, [-0.1 + 0.01 * i for i in range(20)], atol=1e-12)


def test_each_option_is_decoded_from_its_shifted_row(case):
    policy, found = case
    assert found.actions.shape == (3, 4, 20, 2)

    @compiled
    def decode(rows):
        every = policy.agent.every_policy(
            policy.params | {"embeddings": rows}, policy.normalized(STATES)
        )
        return every.mean()  # [S, K, A]

    rows = np.asarray(policy.params["embeddings"])
    for k, e, d in [(0, 0, 0), (1, 3, 19), (2, 1, 4)]:
        moved = rows.copy()
        moved[k, e] += SHIFTS[d]
        expected = decode(moved)[:, k].mean(axis=0)
        np.testing.assert_allclose(found.actions[k, e, d], expected, rtol=1e-4, atol=1e-5)


def test_slopes_are_those_of_lines_through_the_shifted_actions(case):
    _, found = case
    for k, e in np.ndindex(3, 4):
        lines = np.polyfit(found.shifts, found.actions[k, e], 1)[0]
        np.testing.assert_allclose(found.slopes[k, e], lines, rtol=0.02, atol=2e-3)
    assert np.abs(found.slopes).max() > 0.05


def test_options_without_embeddings_are_not_perturbed(key):
    agent = DAC(hidden_sizes=(8,))
    assert perturb(jax.jit(lambda key: untrained(agent, key))(key), STATES) is None


def test_dimensions_are_told_by_what_they_move_most():
    slopes = np.array([[0.1, 0.0], [-0.2, 0.5], [0.0, 0.31], [-0.9, 0.2]])
    assert strongest(slopes).tolist() == [3, 1, 2, 0]
    assert sentences(slopes, ["hip", "knee"], 2) == [
        "dimension 3 moves hip by -0.9 a unit",
        "dimension 1 moves knee by +0.5 a unit",
    ]
    assert len(sentences(slopes, ["hip", "knee"], 9)) == 4
