from collections import Counter

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hitmdp_jax.agents import DAC
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.interpret.interventions import (
    Interventions,
    alike,
    divergence,
    effects,
    held,
    intervene,
    shuffled,
    summary,
    table,
)
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from tests.interpret.known_returns import Payment, obvious
from tests.interpret.test_option_use import episodes, pad, padding, runs
from tests.probes import spec_of_sizes
from tests.programs import compiled

STEPS = Payment.episode_length


def test_each_intervention_earns_what_its_options_do_and_the_summary_says_so(key):
    own = jax.device_get(run_episodes(obvious(), Payment(), key, 5))
    found = intervene(obvious(), Payment(), key, own)
    returns = dict(zip(found.names, found.returns, strict=True))
    assert list(returns) == [
        "own choices", "own, shuffled", "uniform choices", "uniform, held", "first choice",
        "option 0", "option 1", "option 2",
    ]  # fmt: skip
    expected = own.option.sum(axis=0)
    np.testing.assert_allclose(returns["own choices"], expected, atol=1e-4)
    np.testing.assert_allclose(returns["own, shuffled"], expected, atol=1e-4)
    np.testing.assert_allclose(returns["first choice"], STEPS * own.option[0], atol=1e-4)
    for k in range(3):
        np.testing.assert_allclose(returns[f"option {k}"], STEPS * k, atol=1e-4)
    columns = summary(found)
    assert columns["best_option"] == pytest.approx(2 * STEPS)
    assert columns["worst_option"] == pytest.approx(0.0, abs=1e-4)
    assert columns["own_choices"] == pytest.approx(expected.mean(), abs=1e-4)
    assert columns["shuffled_choices"] == pytest.approx(expected.mean(), abs=1e-4)
    assert columns["first_choice"] == pytest.approx(STEPS * own.option[0].mean(), abs=1e-4)
    uniform = returns["uniform choices"]
    np.testing.assert_allclose(uniform, uniform.round(), atol=1e-4)
    assert len(set(uniform.round())) > 1  # chance, another for each episode
    np.testing.assert_array_equal(found.lengths, np.full((8, 5), STEPS))


class Drawn(Payment):
    """The task, which draws itself, so that its whole states are recorded."""

    def draw(self, state):
        raise NotImplementedError


def test_of_each_option_alone_the_first_episode_is_kept_for_pictures(key):
    own = jax.device_get(run_episodes(obvious(), Drawn(), key, 5))
    found = intervene(obvious(), Drawn(), key, own, physics=True)
    assert found.alone is not None
    assert found.alone.option.shape == (3, STEPS, 1)
    for k, option in enumerate(found.alone.option):
        assert set(option.ravel().tolist()) == {k}
    np.testing.assert_array_equal(found.alone.reward.sum((1, 2)), found.returns[-3:, 0])
    np.testing.assert_array_equal(found.alone.state.obs, found.alone.obs)
    for obs in found.alone.obs:
        np.testing.assert_array_equal(obs[0, 0], own.obs[0, 0])  # all begin in one state
    assert intervene(obvious(), Drawn(), key, own).alone is None


@given(episodes, padding, st.integers(0, 99))
def test_shuffling_keeps_each_episodes_activations(episodes, padding, seed):
    option, alive = pad(episodes, padding)
    found = shuffled(option, alive, np.random.default_rng(seed))
    assert found.shape == option.shape
    for n, episode in enumerate(episodes):
        column = found[:, n].tolist()
        whole, rest = divmod(len(column), len(episode))
        for i in range(whole):
            part = column[i * len(episode) : (i + 1) * len(episode)]
            assert Counter(part) == Counter(episode)
            # Activations that meet become one: there are no more of them, and none is cut.
            assert len(runs(part)) <= len(runs(episode))
        assert not Counter(column[len(column) - rest :]) - Counter(episode)


@given(episodes, padding, st.integers(0, 99))
def test_held_options_last_as_long_as_the_policys_own(episodes, padding, seed):
    option, alive = pad(episodes, padding)
    found = held(option, alive, 9, np.random.default_rng(seed))
    for n, episode in enumerate(episodes):
        ends = np.cumsum([duration for _, duration in runs(found[: len(episode), n].tolist())])
        # A change lies where some order of the policy's own durations has one.
        sums = {0}
        for _, duration in runs(episode):
            sums |= {total + duration for total in sums}
        assert set(ends.tolist()) <= sums


def test_held_options_are_drawn_evenly_and_not_after_the_policy():
    option = np.repeat([0, 0, 1, 0], 5)[:, None].repeat(400, axis=1)
    found = held(option, np.ones_like(option, bool), 4, np.random.default_rng(0))
    share = np.bincount(found.ravel(), minlength=4) / found.size
    np.testing.assert_allclose(share, 0.25, atol=0.04)


def test_shuffling_changes_the_order():
    option = np.repeat(np.arange(3), 4)[:, None]
    alive = np.ones_like(option, bool)
    orders = {tuple(shuffled(option, alive, np.random.default_rng(i))[:, 0]) for i in range(30)}
    assert len(orders) == 6


@pytest.mark.parametrize(
    ("divergence", "said"),
    [
        (0.001 * (1 - np.eye(3)), "The options are practically identical: no two of them are 0.01"),
        (0.48 * (1 - np.eye(3)), "No two options are practically identical"),
        (
            np.array([[0, 0.001, 1], [0.001, 0, 1], [1, 1, 0]]),
            "Practically identical, less than 0.01 nats apart: options 0 and 1.",
        ),
        (
            np.where(np.arange(6) == 5, 1.0, 0.001),
            "options 0 and 1; 0 and 2; 0 and 3; 0 and 4; 1 and 2; 1 and 3; 4 more pairs.",
        ),
    ],
)
def test_options_that_are_practically_identical_are_named(divergence, said):
    assert said in alike(np.broadcast_to(divergence, (divergence.shape[-1],) * 2))


def test_divergence_is_the_mean_of_both_kls_over_states(key):
    agent, states = (
        DAC(num_options=3, hidden_sizes=(8,), spec=spec_of_sizes(5, 2)),
        np.random.default_rng(0).normal(size=(4, 5)),
    )

    @compiled
    def heads_and_divergence(key):
        params = agent.init(key, agent.spec).params
        scatter = jax.random.normal(key, (3, 2))
        params = jax.tree.map(lambda x: x + 0.3 * jax.random.normal(key, x.shape), params)
        policy = Policy(agent, params | {"rho": scatter}, initial_statistics(5))
        heads = agent.heads(policy.params, policy.normalized(states))
        return heads.action, heads.std, divergence(policy, states)

    mean, std, found = heads_and_divergence(key)
    expected = np.zeros((3, 3))
    for s, i, j in np.ndindex(4, 3, 3):
        for p, q in ((i, j), (j, i)):
            gap = np.square(mean[s, p] - mean[s, q])
            kl = np.log(std[q] / std[p]) + (std[p] ** 2 + gap) / (2 * std[q] ** 2) - 0.5
            expected[i, j] += kl.sum() / 2 / 4
    assert expected.max() > 0.01
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5)


RETURNS = np.array([[1.0, 3.0, 5.0], [2.0, 5.0, 8.0]])


def test_effects_pair_the_episodes():
    found = effects(Interventions(("own choices", "option 0"), RETURNS, RETURNS))
    np.testing.assert_allclose(found.mean, [3, 5])
    np.testing.assert_allclose(found.difference, [0, 2])
    # Of the differences 1, 2 and 3: Student's t of two degrees of freedom, as tables have it.
    np.testing.assert_allclose(found.half_width, [0, 4.303 / 3**0.5], rtol=1e-4)


@pytest.mark.parametrize(
    ("episodes", "row"),
    [
        (3, ["option 0", "5.0", "+2.0", "-0.5 to +4.5"]),
        (1, ["option 0", "2.0", "+1.0", "-"]),
    ],
)
def test_the_table_measures_against_own_choices(episodes, row):
    returns = RETURNS[:, :episodes]
    header, own, other = table(Interventions(("own choices", "option 0"), returns, returns))
    assert header == ["options", "return", "minus own choices", "95% interval"]
    assert own[2:] == ["-", "-"]
    assert other == row
