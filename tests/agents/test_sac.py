"""SAC against loops in NumPy, and what its replay and its warm-up are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import norm

import hitmdp_jax
from hitmdp_jax.agents import SAC, HitSAC
from hitmdp_jax.agents.sac import CRITICS
from hitmdp_jax.envs.spec import Box, Discrete, Observation, Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.networks import TanhGaussian
from tests.agents.option_batches import A, B, O, T, random_batch, random_params
from tests.probes import Counter
from tests.programs import compiled

RANGE = Spec(Observation((O,)), Box((-2.0, 0.0), (2.0, 1.0)))
SMALL = {"hidden_sizes": (8,), "batch_size": 16, "replay_size": 64, "warmup_steps": 8}
AGENT = SAC(spec=RANGE, gamma=0.9, polyak=0.1, learning_rate=0.01, **SMALL)


def rollout():
    """A rollout whose actions lie within the range; environment 0 terminates, 1 is cut off."""
    batch = random_batch()
    action = RANGE.action.clip(batch.action)
    return batch.replace(record=(), memory=(), action=np.asarray(action))


def moderate(agent):
    """Random parameters under which few actions lie so near the range's ends that float32 ends."""
    params = random_params(agent)
    return params | {"actor": jax.tree.map(lambda x: 0.3 * x, params["actor"])}


def layers(params, x):
    """A body of one hidden layer, and what its inputs are called."""
    for name, value in x.items():
        x[name] = value @ params["body"][name]["kernel"] + params["body"][name].get("bias", 0.0)
    return np.maximum(sum(x.values()), 0.0)


def gaussian(params, obs):
    head = params["actor"]["gaussian"]
    out = layers(params["actor"], {"input_0": obs}) @ head["kernel"] + head["bias"]
    mean, log_std = np.split(out, 2)
    return mean, np.exp(np.clip(log_std, -20, 2))


def critics(params, obs, action):
    """Both critics' values of one action within +-1."""
    found = []
    for name in CRITICS:
        hidden = layers(params[name], {"input_0": obs, "input_action": action})
        found.append((hidden @ params[name]["value"]["kernel"] + params[name]["value"]["bias"])[0])
    return np.array(found)


def log_density(mean, std, before):
    """log P(a | s) of a = tanh(before), by the change of variables."""
    return (norm.logpdf(before, mean, std) - np.log(1 - np.tanh(before) ** 2)).sum()


@pytest.mark.parametrize("bootstrap", [True, False])
def test_targets_are_those_of_a_loop(bootstrap):
    """A termination ends the return; a time limit does not, but where that is asked for."""
    agent = AGENT.replace(bootstrap_on_truncation=bootstrap)
    params = moderate(agent)
    target = jax.tree.map(lambda x: -0.5 * x, {x: params[x] for x in CRITICS})
    batch, key = rollout(), jax.random.key(5)

    @compiled
    def run(params, target, batch):
        step = agent.store(agent.init_replay(RANGE), batch).data
        found = agent.q_target(params, params | target, step, key)
        return found, agent.draw(params, step.next_obs, key)[0]

    found, drawn = run(params, target, batch)
    for t in range(T):
        for b in range(B):
            n, after = t * B + b, batch.next_obs[t, b]
            mean, std = gaussian(params, after)
            log_prob = log_density(mean, std, np.arctanh(drawn[n].astype(float)))
            value = critics(target, after, drawn[n]).min()
            value -= np.exp(params["log_temperature"]) * log_prob
            ends = batch.terminated[t, b] or (batch.truncated[t, b] and not bootstrap)
            expected = batch.reward[t, b] + 0.9 * (0.0 if ends else value)
            np.testing.assert_allclose(found[n], expected, rtol=2e-3, atol=2e-3)


@pytest.fixture(scope="module")
def evaluated():
    """The loss of the newest steps, what it measures, its gradient, and the actions drawn."""
    params, batch = moderate(AGENT), rollout()
    target = {x: params[x] for x in CRITICS}

    @compiled
    def run(params):
        replay = AGENT.store(AGENT.init_replay(RANGE), batch)
        step = jax.tree.map(lambda x: x[: T * B], replay.data)
        data = {"step": step, "target": target, "key": jax.random.key(3)}
        (loss, metrics), slopes = jax.value_and_grad(AGENT.loss, has_aux=True)(params, data)
        key_target, key_policy = jax.random.split(data["key"])
        aim = AGENT.q_target(params, params, step, key_target)
        drawn, log_prob = AGENT.draw(params, step.obs, key_policy)
        return loss, metrics, slopes, step, aim, drawn, log_prob

    return params, *run(params)


def test_the_loss_is_that_of_a_loop(evaluated):
    params, loss, metrics, _, step, aim, drawn, log_prob = evaluated
    middle, half = np.array([0.0, 0.5]), np.array([2.0, 0.5])
    temperature = np.exp(params["log_temperature"])
    total, of_values = 0.0, 0.0
    for n in range(T * B):
        action = (step.action[n] - middle) / half
        errors = critics(params, step.obs[n], action) - aim[n]
        of_values += 0.5 * (errors**2).sum() / (T * B)
        q = critics(params, step.obs[n], drawn[n]).min()
        too_little = -A - -log_prob[n]  # of entropy
        total += (temperature * log_prob[n] - q) / (T * B)
        total -= params["log_temperature"] * too_little / (T * B)
    np.testing.assert_allclose(metrics["value_loss"], of_values, rtol=1e-4)
    np.testing.assert_allclose(loss, total + of_values, rtol=1e-4)


def test_each_part_learns_from_its_own_loss_alone(evaluated):
    """The critics are not bent to please the policy, nor the policy to make targets likely."""
    params, _, _, slopes, step, aim, _, log_prob = evaluated

    @compiled
    @jax.grad
    def of_critics(params):
        obs, action, _ = AGENT.learned_options(step)
        q = AGENT.network().apply({"params": params}, obs, action, method="q")
        return 0.5 * jnp.square(q - aim).mean(1).sum()

    for name in CRITICS:
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-4, atol=1e-5),
            slopes[name],
            of_critics(params)[name],
        )
    # The price rises where the entropy is below its target.
    np.testing.assert_allclose(slopes["log_temperature"], A - log_prob.mean(), rtol=1e-4)
    assert slopes["uniform"] == 0.0


def test_the_policys_expected_direction_is_the_gradient_of_the_soft_objective():
    """E_a [alpha log P - min Q] over a line of actions, integrated, against many draws."""
    spec = Spec(Observation((1,)), Box((-1.0,), (1.0,)))
    agent = SAC(spec=spec, hidden_sizes=(4,), activation="tanh")
    params, obs = random_params(agent), np.array([0.3], np.float32)
    before = np.linspace(-8.0, 8.0, 2001)[:, None].astype(np.float32)  # tanh

    def integrated(actor):
        mean, std = agent.network().apply(
            {"params": params | {"actor": actor}}, obs, method="gaussian"
        )
        density = jnp.exp(-0.5 * jnp.square((before - mean) / std)) / (std * jnp.sqrt(2 * jnp.pi))
        log_slope = jnp.log(1.0 - jnp.square(jnp.tanh(before)) + 1e-12)
        log_prob = (jnp.log(density + 1e-30) - log_slope)[:, 0]
        q = agent.network().apply({"params": params}, obs, jnp.tanh(before), method="q").min(0)
        worth = jnp.exp(params["log_temperature"]) * log_prob - q
        return jax.scipy.integrate.trapezoid(density[:, 0] * worth, before[:, 0])

    def sampled(actor, key):
        fixed = params | {"actor": actor}
        drawn, log_prob = agent.draw(fixed, jnp.broadcast_to(obs, (20_000, 1)), key)
        q = agent.network().apply({"params": params}, obs[None], drawn, method="q").min(0)
        return (jnp.exp(params["log_temperature"]) * log_prob - q).mean()

    exact = compiled(jax.grad(integrated))(params["actor"])
    found = compiled(jax.grad(sampled))(params["actor"], jax.random.key(0))
    scale = max(float(np.abs(x).max()) for x in jax.tree.leaves(exact))
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, atol=0.03 * scale), found, exact)


def test_a_squashed_gaussian_is_a_density_over_its_range():
    low, high = np.array([-2.0, 0.0]), np.array([2.0, 1.0])
    mean, std = np.array([0.3, -1.0], np.float32), np.array([0.5, 1.5], np.float32)

    @compiled
    def run(key):
        policy = TanhGaussian(mean, std, low, high)
        lines = jnp.linspace(low + 1e-3, high - 1e-3, 400)
        one = TanhGaussian(mean[:1], std[:1], low[:1], high[:1])
        sample, log_prob = policy.sample_and_log_prob(seed=key, sample_shape=(4000,))
        return (
            jnp.exp(one.log_prob(lines[:, :1])),
            lines[:, 0],
            (sample, log_prob, policy.log_prob(sample)),
            (*policy.mode_and_log_prob(), policy.mode(), policy.log_prob(policy.mode())),
            TanhGaussian(mean, 0.01 * std, low, high).stddev(),
        )

    density, line, (sample, log_prob, again), (mode, at_mode, same, told), narrow = run(
        jax.random.key(0)
    )
    assert trapezoid(density, line) == pytest.approx(1.0, abs=0.02)
    assert (sample >= low).all()
    assert (sample <= high).all()
    np.testing.assert_allclose(np.median(sample, axis=0), mode, atol=0.06)
    near = np.abs((sample - [0.0, 0.5]) / [2.0, 0.5]).max(1) < 0.99
    np.testing.assert_allclose(log_prob[near], again[near], atol=0.02)
    np.testing.assert_array_equal(mode, same)
    np.testing.assert_allclose(at_mode, told, rtol=1e-4)
    slopes = 1 - np.tanh(mean) ** 2
    np.testing.assert_allclose(narrow, 0.01 * std * slopes * [2.0, 0.5], rtol=1e-4)


@pytest.mark.parametrize("warmup_steps", [15, 16])
def test_nothing_is_learned_before_the_warm_up_and_then_the_targets_follow(warmup_steps):
    """A rollout of 15 steps, and one gradient step for each of them."""
    batch, agent = rollout(), AGENT.replace(warmup_steps=warmup_steps)

    @compiled
    def run(key):
        state = agent.init(key, RANGE)
        replay = agent.store(agent.init_replay(RANGE), batch)
        return state, agent.update(state, batch.replace(replay=replay), key)[0]

    first, last = run(jax.random.key(0))
    if warmup_steps > 15:
        jax.tree.map(np.testing.assert_array_equal, first, last)
        return
    assert (first.params["uniform"], last.params["uniform"]) == (1.0, 0.0)
    for name in CRITICS:  # they have gone a part of the way, all in one direction at first
        start, now, target = first.target[name], last.params[name], last.target[name]
        way = jax.tree.map(lambda x, y, z: ((y - x) * (z - x)).sum(), start, now, target)
        whole = jax.tree.map(lambda x, y: jnp.square(y - x).sum(), start, now)
        share = sum(jax.tree.leaves(way)) / sum(jax.tree.leaves(whole))
        assert 0.3 < share < 1 - 0.9**15


def test_one_polyak_step_is_a_weighted_mean():
    """Critics that do not move are where the targets go: from 1 to 1 - 0.1 after a step."""
    state, moved = {"x": np.ones(3)}, {"x": np.zeros(3)}
    found = compiled(AGENT.follow)(moved, state)
    np.testing.assert_allclose(found["x"], 0.9)


def test_first_actions_are_uniform_over_the_range_and_later_ones_the_policys():
    params = random_params(AGENT)

    @compiled
    def acted(params):
        obs = jnp.zeros((4000, O))
        action, _, _ = AGENT.act(params, obs, (), jax.random.key(0))
        return action, AGENT.act(params, obs[:1], (), jax.random.key(0), True)[0]

    uniform, mode = acted(params | {"uniform": np.float32(1.0)})
    np.testing.assert_allclose(uniform.mean(0), [0.0, 0.5], atol=0.06)
    np.testing.assert_allclose(uniform.std(0), [4 / 12**0.5, 1 / 12**0.5], rtol=0.05)
    own, same = acted(params | {"uniform": np.float32(0.0)})
    np.testing.assert_array_equal(mode, same)
    np.testing.assert_allclose(np.median(own, axis=0), mode[0], atol=0.2)


SIZES = {"num_envs": 2, "rollout_length": 4, "num_steps": 64, "episode_length": 3}


@pytest.fixture(scope="module")
def trained():
    """Two seeds side by side and the second alone, of options: their update is SAC's and more."""
    sizes = {"hidden_sizes": (4,), "batch_size": 4, "replay_size": 32, "warmup_steps": 16}
    agent = HitSAC(num_options=3, **sizes)

    def run(key):
        return hitmdp_jax.train(agent, Counter(), key, **SIZES)

    keys = jax.random.split(jax.random.key(0))
    return compiled(jax.vmap(run))(keys), compiled(run)(keys[1])


@pytest.mark.whole
def test_a_seed_learns_alone_what_it_learns_beside_others(trained):
    (state, metrics), (alone, of_alone) = trained
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x[1], y, rtol=1e-4, atol=1e-5),
        (state.learner.params, state.learner.target, metrics["loss"]),
        (alone.learner.params, alone.learner.target, of_alone["loss"]),
    )
    jax.tree.map(lambda x, y: np.testing.assert_array_equal(x[1], y), state.replay, alone.replay)


@pytest.mark.whole
def test_the_replay_holds_what_followed_and_not_what_a_reset_showed(trained):
    """The task counts its steps and never ends: every end is a time limit, and bootstraps."""
    replay = trained[1][0].replay
    assert replay.size == 32
    np.testing.assert_array_equal(replay.data.next_obs, replay.data.obs + np.array([1.0, 0.0]))
    assert replay.data.obs[:, 0].max() == 2
    assert (replay.data.done == 0).all()
    counts = trained[1][1]["option_steps"][-4:].sum(0)  # of the 32 steps that the replay holds
    np.testing.assert_array_equal(np.bincount(replay.data.record, minlength=3), counts)


def test_learning_begins_with_the_iteration_that_fills_the_warm_up(trained):
    temperature = trained[1][1]["temperature"]
    np.testing.assert_allclose(temperature[:2], [1.0, temperature[1]])
    assert temperature[0] == 1.0
    assert temperature[2] < 1.0


def test_what_cannot_be_learned_is_refused():
    choices = Spec(Observation((4,)), Discrete(2))
    with pytest.raises(UsageError, match="SAC needs actions that are numbers, and here an action"):
        SAC().bind(choices)
    with pytest.raises(UsageError, match="warmup_steps = 99 is more than replay_size = 8 can hold"):
        SAC(replay_size=8, warmup_steps=99)
