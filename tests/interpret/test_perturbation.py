import jax
import numpy as np
import pytest

from hitmdp_jax.agents import DAC, MOPG
from hitmdp_jax.interpret.perturbation import SHIFTS, Perturbation, perturb, sentences, strongest
from tests.probes import spec_of_sizes, untrained_policy
from tests.programs import compiled

STATES = np.random.default_rng(0).normal(size=(6, 5)).astype(np.float32)


def untrained(agent, key):
    policy = untrained_policy(agent.bind(spec_of_sizes(5, 2)), key)
    params = policy.params
    if "decoder" in params:  # a first policy hardly moves
        decoder = params["decoder"]
        params = params | {
            "decoder": decoder | {"mean": jax.tree.map(lambda x: 50 * x, decoder["mean"])}
        }
    return policy.replace(params=params)


@pytest.fixture(scope="module")
def case():
    agent = MOPG(
        num_options=3, embedding_size=4, hidden_sizes=(8,), activation="tanh",
        option_scale=1.0,
    )  # fmt: skip
    policy = jax.jit(lambda key: untrained(agent, key))(jax.random.key(0))
    return policy, perturb(policy, STATES)


def test_the_shifts_are_symmetric_and_as_wide_as_the_embeddings():
    np.testing.assert_array_equal(SHIFTS, -SHIFTS[::-1])
    assert (SHIFTS.min(), SHIFTS.max()) == (-2.0, 2.0)
    assert 0.0 in SHIFTS


def test_each_option_is_decoded_from_its_shifted_row(case):
    policy, found = case
    assert found.actions.shape == (3, 4, 21, 2)

    @compiled
    def decode(rows):
        every = policy.agent.every_policy(
            policy.params | {"embeddings": rows}, policy.normalized(STATES)
        )
        return every.mean()  # [S, K, A]

    rows = np.asarray(policy.params["embeddings"])
    for k, e, d in [(0, 0, 0), (1, 3, 20), (2, 1, 4)]:
        moved = rows.copy()
        moved[k, e] += SHIFTS[d]
        expected = decode(moved)[:, k].mean(axis=0)
        np.testing.assert_allclose(found.actions[k, e, d], expected, rtol=1e-4, atol=1e-5)


def test_slopes_are_those_of_lines_through_the_shifted_actions(case):
    policy, found = case
    near = perturb(policy, STATES, np.linspace(-0.1, 0.1, 21))
    for k, e in np.ndindex(3, 4):
        lines = np.polyfit(near.shifts, near.actions[k, e], 1)[0]
        np.testing.assert_allclose(found.slopes[k, e], lines, rtol=0.02, atol=2e-3)
    assert np.abs(found.slopes).max() > 0.05


def test_options_without_embeddings_are_not_perturbed(key):
    agent = DAC(hidden_sizes=(8,))
    assert perturb(jax.jit(lambda key: untrained(agent, key))(key), STATES) is None


SLOPES = np.array([[0.1, 0.0], [-0.2, 0.5], [0.0, 0.31], [-0.9, 0.2]])


def along_lines(slopes, noise):
    """What is found of one option whose mean actions follow straight lines."""
    actions = 7.0 + SHIFTS[:, None] * slopes[:, None]
    return Perturbation(SHIFTS, actions[None], slopes[None], np.full(2, noise))


def test_dimensions_are_told_by_what_they_move_most():
    found = along_lines(SLOPES, 1.0)
    assert strongest(SLOPES).tolist() == [3, 1, 2, 0]
    assert sentences(found, 0, ["hip", "knee"], 2) == [
        "dimension 3 moves hip by -0.9 per unit",
        "dimension 1 moves knee by +0.5 per unit",
    ]
    assert len(sentences(found, 0, ["hip", "knee"], 9)) == 4


def test_what_cannot_be_noticed_is_not_told_as_if_it_were_something():
    """A change is seen by the side of the actions' own noise: 0.14 of it is 0.01 nats."""
    found = along_lines(SLOPES / 10, 1.0)
    np.testing.assert_allclose(found.effects, [[0.02, 0.1, 0.062, 0.18]])
    assert sentences(found, 0, ["hip", "knee"], 9) == ["dimension 3 moves hip by -0.09 per unit"]
    assert not found.negligible
    assert found.summary.endswith("at most 0.18 standard deviations of the policy's actions.")
    tiny = along_lines(SLOPES / 3e4, 1.0)
    assert tiny.negligible
    assert sentences(tiny, 0, ["hip", "knee"], 9) == ["no dimension moves an actuator noticeably"]
    assert tiny.summary.endswith("actions: practically nothing.")


def test_of_choices_it_is_the_log_probabilities_that_change():
    found = along_lines(SLOPES, 1.0)._replace(choices=True)
    assert sentences(found, 0, ["north", "east"], 1) == [
        "dimension 3 changes the log-probability of north by -0.9 per unit"
    ]
    assert found.summary == "Shifts by up to 2 change log-probabilities by at most 1.8 nats."
    tiny = along_lines(SLOPES / 3e4, 1.0)._replace(choices=True)
    assert sentences(tiny, 0, ["north", "east"], 1) == ["no dimension changes a choice noticeably"]
