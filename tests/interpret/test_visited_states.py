import numpy as np
import pytest
from scipy.special import expit, softmax

from hitmdp_jax.agents import DAC, MOPG, PPO
from hitmdp_jax.interpret.episodes import Trajectories
from hitmdp_jax.interpret.visited_states import (
    States,
    attention,
    cosine_similarities,
    terminations,
    typical,
    visited,
)
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from tests.probes import spec_of_sizes, untrained_policy
from tests.programs import compiled

SMALL = {"hidden_sizes": (8,), "spec": spec_of_sizes(5, 2)}
LENGTHS = (4, 1, 6)
STATES = States(
    np.random.default_rng(0).normal(size=(7, 5)).astype(np.float32),
    np.zeros(7, int),
    np.arange(7) % 3,
    np.arange(7),
    np.zeros(7, int),
)


def recorded():
    random = np.random.default_rng(0)
    steps, number = max(LENGTHS), len(LENGTHS)
    return Trajectories(
        obs=random.normal(size=(steps, number, 2)),
        action=None,
        reward=None,
        option=random.integers(3, size=(steps, number)),
        option_probs=None,
        alive=np.arange(steps)[:, None] < LENGTHS,
        control_steps=None,
        terminated=None,
    )


def test_all_steps_of_all_episodes_are_visited():
    episodes = recorded()
    expected = [(t, n) for n, length in enumerate(LENGTHS) for t in range(length)]
    found = visited(episodes)
    assert len(found.obs) == len(expected)
    for obs, option, previous, step, episode, (t, n) in zip(*found, expected, strict=True):
        assert (step, episode) == (t, n)
        np.testing.assert_array_equal(obs, episodes.obs[t, n])
        assert option == episodes.option[t, n]
        assert previous == episodes.option[max(t - 1, 0), n]


def test_some_steps_are_spread_over_the_episodes():
    episodes, every = recorded(), visited(recorded())
    found = visited(episodes, 3)
    np.testing.assert_array_equal(found.obs, every.obs[[0, 5, 10]])


@pytest.mark.parametrize("form", ["similarity", "printed"])
def test_attention_is_the_softmax_of_queries_and_keys(form, key):
    agent = MOPG(num_options=3, embedding_size=4, master_policy=form, **SMALL)
    policy, found = compiled(lambda key: (p := untrained_policy(agent, key), attention(p, STATES)))(
        key
    )
    rows, encoder = policy.params["embeddings"], policy.params["encoder"]
    obs, body = np.clip(STATES.obs, -10, 10), encoder["query_body"]
    hidden = obs @ body["input_0"]["kernel"] + body["input_0"]["bias"]
    hidden = hidden + (rows / 2 @ body["input_1"]["kernel"])[STATES.previous]  # sqrt(E) = 2
    query = np.maximum(hidden, 0) @ encoder["query"]["kernel"] + encoder["query"]["bias"]
    if form == "similarity":
        query = query + rows[STATES.previous]
    weights = encoder["attention"]
    query = query @ weights["query_kernel"] + weights["query_bias"]
    keys = rows @ weights["key_kernel"] + weights["key_bias"]
    np.testing.assert_allclose(found, softmax(query @ keys.T / 2, axis=1), rtol=1e-4, atol=1e-5)


def test_terminations_are_the_sigmoid_of_their_head(key):
    agent = DAC(num_options=3, **SMALL)

    @compiled
    def run(key):
        policy = untrained_policy(agent, key)
        heads = agent.heads(policy.params, policy.normalized(STATES.obs))
        return heads.termination, terminations(policy, STATES)

    logits, found = run(key)
    assert found.shape == (7, 3)
    np.testing.assert_allclose(found, expit(logits), rtol=1e-5)


def test_what_an_agent_lacks_is_none(key):
    for agent in (PPO(**SMALL), DAC(**SMALL)):
        assert attention(Policy(agent, (), initial_statistics(5)), STATES) is None
    for agent in (PPO(**SMALL), MOPG(**SMALL)):
        assert terminations(Policy(agent, (), initial_statistics(5)), STATES) is None


def test_a_typical_state_is_where_an_options_states_lie_most_densely():
    """Neither the mean, 5 and 105, nor the state in the middle of all is."""
    dense = np.array([0.0, 0.2, 0.3, 0.4])
    points = np.concatenate([dense, np.linspace(4.0, 16.0, 17)])[:, None]
    option = np.zeros(len(points), int)
    assert typical(points, option) == {0: 1}  # the nearest three beside it are 0.2 away
    both = np.concatenate([points + 100.0, points])
    assert typical(both, np.repeat([3, 0], len(points))) == {0: len(points) + 1, 3: 1}
    assert typical(points[:1], np.array([7])) == {7: 0}


def test_cosines_of_rows():
    rows = np.array([[2.0, 0.0], [0.0, 3.0], [1.0, 1.0], [0.0, 0.0]])
    half = 0.5**0.5
    expected = [[1, 0, half, 0], [0, 1, half, 0], [half, half, 1, 0], [0, 0, 0, 0]]
    np.testing.assert_allclose(cosine_similarities(rows), expected)
