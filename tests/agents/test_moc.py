"""MOC's loss against the update of its paper, and against PPOC's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import MOC, PPOC
from tests.agents.compiled import Compiled
from tests.agents.option_batches import (
    SMALL,
    B,
    K,
    T,
    assert_ascends,
    flatten,
    log_density,
    normal,
    option_probabilities,
    random_batch,
)


@pytest.fixture
def agent():
    """Everything is learned from, and nothing is clipped: what other options do is far off."""
    return Compiled(MOC(eta=1.0, clip_eps=float("inf"), entropy_weight=0.0, **SMALL))


@pytest.fixture
def data(agent, params):
    """A rollout as the loss reads it, with made-up advantages of actions and targets."""
    data, _ = agent.targets(params, random_batch())
    advantage, target = normal(np.random.default_rng(1), 2, T, B)
    nothing = {"advantage_option": np.zeros((T, B), np.float32)}
    return flatten(data | nothing | {"advantage_action": advantage, "q_target": target})


def test_every_option_learns_by_its_probability_and_its_importance(agent, params, data):
    """Klissarov & Precup 2021: P(o | s, o_prev) and the ratio of action and next option weigh."""
    sg = jax.lax.stop_gradient

    def plain(params, sample):
        heads, memory = agent.heads(params, sample["obs"]), sample["memory"]
        probs = option_probabilities(heads, memory.previous, memory.initial)
        log_prob = jnp.stack([log_density(params, heads, o, sample["action"]) for o in range(K)])
        likelier = log_prob - log_prob[sample["option"]] + sample["log_ratio_next"]
        weight = sg(probs * jnp.exp(likelier))
        beta = jax.nn.sigmoid(heads.termination[memory.previous])
        going_on = sg(heads.value[memory.previous] - jnp.exp(heads.log_master) @ heads.value)
        return (
            weight @ (sample["advantage_action"] * log_prob)
            - 0.5 * weight @ jnp.square(heads.value - sample["q_target"])
            - jnp.where(memory.initial, 0.0, beta * (going_on + 0.01))
        )

    assert_ascends(agent.loss, plain, params, data)


def test_what_follows_is_weighed_by_how_likely_it_was_after_each_option(agent, params):
    """Step by step, and by nothing where the episode or the rollout ends."""
    batch = random_batch()
    data, _ = agent.targets(params, batch)
    ratios = np.asarray(data["log_ratio_next"])
    for t in range(T):
        for b in range(B):
            if t == T - 1 or batch.terminated[t, b] or batch.truncated[t, b]:
                np.testing.assert_array_equal(ratios[t, b], 0.0)
                continue
            heads = agent.heads(params, batch.next_obs[t, b])
            after = [option_probabilities(heads, o, False) for o in range(K)]
            likely = np.array([after[o][batch.record[t + 1, b]] for o in range(K)])
            expected = np.log(likely / likely[batch.record[t, b]])
            np.testing.assert_allclose(ratios[t, b], expected, rtol=1e-3, atol=1e-5)
    assert np.ptp(ratios[0]) > 0.1


def test_without_eta_it_is_ppoc(params, data):
    moc, ppoc = Compiled(MOC(eta=0.0, **SMALL)), Compiled(PPOC(**SMALL))
    mine, theirs = moc.loss(params, data)[0], ppoc.loss(params, data)[0]
    np.testing.assert_allclose(mine, theirs, rtol=1e-5)
