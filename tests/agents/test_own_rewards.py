"""MOPG's options with rewards of their own and a sticky prior, against plain loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import rel_entr

from hitmdp_jax import UsageError, make_env, train
from hitmdp_jax.agents import MOPG, PPO
from hitmdp_jax.learning.options import standardize_by_option
from hitmdp_jax.networks import OptionDirections
from hitmdp_jax.training.program import make_train
from tests.agents.compiled import Compiled
from tests.agents.option_batches import SMALL, B, K, T, flatten, normal, random_batch, random_params
from tests.learning.test_advantages import advantages_by_loop
from tests.programs import OPTIMIZED, compiled

REWARDS = ("left", "right")
AGENT = MOPG(option_rewards=REWARDS, switching_cost=0.0, usage_weight=0.0, own_gamma=0.9, **SMALL)


@pytest.fixture
def batch():
    batch = random_batch()
    paid = normal(np.random.default_rng(2), T, B, len(REWARDS))
    return batch.replace(memory=batch.memory.previous, option_reward=paid)


def test_own_advantages_equal_their_definition(agent, params, batch):
    """An option that the master leaves goes on for ever in its own eyes: a loop over the steps."""
    advantage, target = agent.own_advantages(params, batch)
    paid, q, q_next = np.zeros((3, T, B))
    left = np.zeros((T, B), bool)
    for t, b in np.ndindex(T, B):
        option = batch.record[t, b]
        paid[t, b] = batch.option_reward[t, b, option % len(REWARDS)]
        q[t, b] = agent.own_q(params, batch.obs[t, b][None], option[None])[0]
        q_next[t, b] = agent.own_q(params, batch.next_obs[t, b][None], option[None])[0]
        left[t, b] = t + 1 < T and batch.record[t + 1, b] != option
    assert left.any()
    ends = batch.terminated, batch.truncated | left
    expected = advantages_by_loop(paid, q, q_next, *ends, 0.9, 0.95, True)
    np.testing.assert_allclose(advantage, expected, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(target, expected + q, rtol=1e-3, atol=1e-3)


def test_advantages_are_standardized_for_each_option_alone(agent, params, batch):
    data, _ = agent.targets(params, batch)
    advantage, _ = agent.own_advantages(params, batch)
    for option in range(K):
        steps = batch.record == option
        x = np.asarray(advantage)[steps]
        np.testing.assert_allclose(
            np.asarray(data["advantage_action"])[steps],
            (x - x.mean()) / (x.std() + 1e-8),
            rtol=1e-3,
            atol=1e-3,
        )


def test_an_option_that_never_acts_spoils_nothing():
    x, option = normal(np.random.default_rng(0), T, B), np.zeros((T, B), np.int32)
    result = compiled(standardize_by_option, static_argnums=2)(x, option, K)
    np.testing.assert_allclose(result, (x - x.mean()) / x.std(), rtol=1e-4, atol=1e-5)


def test_the_tasks_reward_moves_the_master_and_the_own_rewards_move_the_actions(
    agent, params, batch
):
    def told(batch):
        data = agent.targets(params, batch)[0]
        return [np.asarray(data[f"advantage_{name}"]) for name in ("option", "action")]

    other_task = told(batch.replace(reward=batch.reward[::-1]))
    other_own = told(batch.replace(option_reward=batch.option_reward[::-1]))
    option, action = told(batch)
    np.testing.assert_array_equal(other_task[1], action)
    np.testing.assert_array_equal(other_own[0], option)
    assert np.abs(other_task[0] - option).max() > 0.1
    assert np.abs(other_own[1] - action).max() > 0.1


def test_the_loss_fits_the_own_critic_in_its_own_units(agent, params, batch):
    data = flatten(agent.targets(params, batch)[0])
    own_q = np.asarray(agent.own_q(params, data["obs"], data["option"]))
    fitted, _ = agent.loss(params, data | {"own_target": own_q})
    off, _ = agent.loss(params, data | {"own_target": own_q + 3.0})
    units = params["own_critic"]["scale"] ** 2
    np.testing.assert_allclose(off - fitted, 4.5 / units, rtol=1e-3)


@pytest.mark.parametrize("stay", [0.5, 0.98])
def test_the_prior_weighs_the_divergence_from_it(stay, agent, params, batch):
    data = flatten(agent.targets(params, batch)[0])
    free, _ = agent.replace(stay=stay).loss(params, data)
    bound, metrics = agent.replace(stay=stay, prior_weight=0.5).loss(params, data)
    probs = np.asarray(agent.option_probs(params, data["obs"], data["previous"]))
    prior = np.full((K, K), (1 - stay) / (K - 1))
    np.fill_diagonal(prior, stay)
    divergence = rel_entr(probs, prior[data["previous"]]).sum(-1).mean()
    np.testing.assert_allclose(metrics["prior_kl"], divergence, rtol=1e-3)
    np.testing.assert_allclose(bound - free, 0.5 * divergence, rtol=1e-3, atol=1e-6)


def test_a_single_option_pays_nothing_for_staying():
    agent = Compiled(MOPG(num_options=1, prior_weight=1.0, stay=0.9, **SMALL))
    batch = random_batch()
    alone = np.zeros((T, B), np.int32)
    params = random_params(agent)
    data = flatten(agent.targets(params, batch.replace(memory=alone, record=alone))[0])
    _, metrics = agent.loss(params, data)
    assert metrics["prior_kl"] == 0.0


def test_the_priors_weight_is_annealed():
    agent = MOPG(prior_weight=1.0, final_prior_weight=0.2, prior_schedule="linear")
    assert float(agent.scheduled(0.25).prior_weight) == pytest.approx(0.8)
    assert float(MOPG(prior_weight=1.0).scheduled(0.5).prior_weight) == pytest.approx(1.0)


def test_without_rewards_of_their_own_there_is_no_second_critic():
    assert "own_critic" not in random_params(Compiled(MOPG(**SMALL)))
    assert "own_critic" in random_params(Compiled(AGENT))


@pytest.mark.whole
def test_a_training_learns_from_them_and_seeds_in_one_program_are_seeds_alone():
    env = make_env("trap/point", physics="native")
    agent = MOPG(
        option_rewards=("north", "task"), action_reads=("body",), num_epochs=1, hidden_sizes=(8,)
    )
    init, step = make_train(agent, env, num_steps=512, num_envs=4, rollout_length=64)

    def run(key):
        first = init(key)
        state, metrics = step(first)
        return first.learner.params, state.learner.params, metrics

    keys = jax.random.split(jax.random.key(0), 2)
    _, together, metrics = compiled(jax.vmap(run))(keys)
    first, alone, _ = compiled(run)(keys[1])
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x[1], y, rtol=1e-3, atol=1e-4), together, alone
    )
    moved = jax.tree.map(lambda x, y: np.abs(x - y).max(), alone, first)
    assert min(jax.tree.leaves(moved["own_critic"]["value"])) > 0
    assert metrics["loss"].shape == (2,)


def test_names_are_a_list():
    with pytest.raises(UsageError, match="option_rewards"):
        MOPG(option_rewards="forward")


class TestLearnedReward:
    AGENT = MOPG(
        option_rewards=("learned", "right"),
        learned_steps=3,
        switching_cost=0.0,
        usage_weight=0.0,
        **SMALL,
    )

    @pytest.fixture
    def agent(self):
        return Compiled(self.AGENT)

    def test_where_an_option_led_ends_with_the_option(self, agent, batch):
        """By a loop: three steps on, or as far as option, episode and rollout go at their pace."""
        found = agent.change(batch)
        ended = batch.terminated | batch.truncated
        for t, b in np.ndindex(T, B):
            last = t
            while (
                last < t + 2
                and last + 1 < T
                and not ended[last, b]
                and batch.record[last + 1, b] == batch.record[t, b]
            ):
                last += 1
            expected = (batch.next_obs[last, b] - batch.obs[t, b]) * 3 / (last - t + 1)
            np.testing.assert_allclose(found[t, b], expected, atol=1e-6)

    def test_it_is_what_the_change_tells_of_the_option(self, agent, batch):
        params = random_params(agent)
        paid, change = agent.own_reward(params, batch), agent.change(batch)
        log_q = np.asarray(agent.log_posterior(params, change))
        np.testing.assert_allclose(np.exp(log_q).sum(-1), 1.0, rtol=1e-5)
        for t, b in np.ndindex(T, B):
            option = batch.record[t, b]
            expected = (
                log_q[t, b, option] + np.log(K) if option % 2 == 0 else batch.option_reward[t, b, 1]
            )
            np.testing.assert_allclose(paid[t, b], expected, rtol=1e-4, atol=1e-5)

    def test_going_on_along_its_direction_pays_an_option_more_and_more(self, agent):
        """By hand: a softmax of K projections on unit vectors, 2 nats for each unit of change."""
        params = random_params(agent)
        rows = np.asarray(params["directions"]["directions"])
        rows = rows - rows.mean(0)
        rows = rows / np.linalg.norm(rows, axis=-1, keepdims=True)
        steps = np.array([0.0, 0.5, 1.0, 2.0])
        found = agent.log_posterior(params, steps[:, None, None] * rows)
        for n, k in np.ndindex(len(steps), K):
            logits = 2.0 * steps[n] * rows @ rows[k]
            expected = logits - np.log(np.exp(logits).sum())
            np.testing.assert_allclose(found[n, k], expected, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(found[0], -np.log(K), rtol=1e-5)  # who stays tells nothing
        own = np.asarray(found)[:, np.arange(K), np.arange(K)]
        assert (np.diff(own, axis=0) > 0.0).all()

    @pytest.mark.parametrize("size", [1, 2, 5])
    @pytest.mark.parametrize("num_options", [1, 2])
    def test_two_options_get_opposite_directions_and_one_tells_nothing(self, num_options, size):
        change = np.ones((3, size), np.float32)
        network = OptionDirections(num_options)
        params = network.init(jax.random.key(size), change)
        value, gradient = jax.value_and_grad(lambda p: network.apply(p, change).sum())(params)
        np.testing.assert_allclose(value, 0.0, atol=1e-5)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(gradient))
        along = np.abs(network.apply(params, change))
        assert (along > 0.0).all() == (num_options == 2)

    def test_q_learns_to_tell_options_by_their_changes(self, agent, batch):
        params = random_params(agent)
        data = flatten(agent.targets(params, batch)[0])
        loss, metrics = agent.loss(params, data)
        log_q = np.asarray(agent.log_posterior(params, data["change"]))
        told = np.take_along_axis(log_q, data["option"][:, None], axis=-1).mean()
        np.testing.assert_allclose(metrics["learned_information"], told + np.log(K), rtol=1e-4)
        share = np.bincount(data["option"], minlength=K) / len(data["option"])
        assert 0.02 < share.min() < share.max()  # so that weights differ, and none is cut off
        gradient = compiled(jax.grad(lambda p: agent.loss(p, data)[0]))(params)["directions"]

        def cross_entropy(params):
            log_q = agent.log_posterior(params, data["change"])
            told = jnp.take_along_axis(log_q, data["option"][:, None], axis=-1)[:, 0]
            return -(told / (K * share[data["option"]])).mean()

        expected = compiled(jax.grad(cross_entropy))(params)["directions"]
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-5), gradient, expected
        )
        assert np.isfinite(loss)


def test_a_learned_reward_needs_nothing_of_the_task():
    env = make_env("toy/cue")
    agent = MOPG(option_rewards=("learned",), num_epochs=1, hidden_sizes=(8,))
    init, step = make_train(agent, env, num_steps=256, num_envs=4, rollout_length=64)
    state, metrics = jax.eval_shape(lambda key: step(init(key)), jax.random.key(0))
    assert metrics["learned_information"].shape == ()
    assert "directions" in state.learner.params


@pytest.mark.slow
def test_options_with_rewards_of_their_own_leave_the_pocket_and_ppo_does_not():
    """Two seeds, 122,880 steps of `trap/point`; about a minute on two cores."""
    env = make_env("trap/point", physics="native")
    exploring = MOPG(
        option_rewards=("east", "north", "west", "south"),
        stay=0.95,
        prior_weight=1.0,
        switching_cost=0.0,
        usage_weight=0.0,
        option_scale=1.0,
        action_reads=("body",),
        minibatch_size=256,
    )

    def success(agent):
        keys = jax.random.split(jax.random.key(7), 2)
        run = jax.vmap(lambda key: train(agent, env, key, num_steps=122_880)[1])
        metrics = jax.jit(run, compiler_options=OPTIMIZED)(keys)
        return np.nanmean(np.asarray(metrics["success"])[:, -8:], axis=1)

    assert (success(exploring) > 0.5).all()
    assert (success(PPO(minibatch_size=256)) < 0.05).all()
