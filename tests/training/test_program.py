import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import MOPG, PPO
from hitmdp_jax.envs.action_repeat import ActionRepeat
from hitmdp_jax.errors import UsageError
from hitmdp_jax.metrics import describe
from hitmdp_jax.training.divergence import CAUSES, freeze_diverged, watched
from hitmdp_jax.training.program import repeat
from hitmdp_jax.training.sizes import num_iterations, pool_period, shortest_episode, usual_pool_size
from hitmdp_jax.training.state import transfer
from tests.probes import Counter, PlaygroundTarget, Remembering, Target

# The algorithm and the size that compile quickest.
AGENT = PPO(num_epochs=2, hidden_sizes=(8,), learning_rate=1e-3)
SIZES = {"num_steps": 3 * 128, "num_envs": 8, "rollout_length": 16}


def assert_close(x, y, **tolerance):
    def compare(a, b):
        if jax.dtypes.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        np.testing.assert_allclose(a, b, **tolerance)

    jax.tree.map(compare, x, y)


def compiled(*program):
    return tuple(map(jax.jit, program))


@pytest.fixture(scope="module")
def program():
    """One run's init and step, compiled."""
    return compiled(*hitmdp_jax.make_train(AGENT, Target(), **SIZES))


@pytest.fixture(scope="module")
def history(program):
    """The states and the metrics [3] of a run."""
    return iterated(*program, jax.random.key(0))


def iterated(init, step, key):
    states, metrics = [init(key)], []
    for _ in range(3):
        state, seen = step(states[-1])
        states.append(state)
        metrics.append(seen)
    return states, jax.tree.map(lambda *x: jnp.stack(x), *metrics)


@pytest.fixture(scope="module")
def swept():
    """The sweep of the design: one compiled program over hyperparameters and seeds."""
    agents = jax.vmap(lambda rate: AGENT.replace(learning_rate=rate))(jnp.array([0.0, 1e-3]))
    train = jax.vmap(lambda a, k: hitmdp_jax.train(a, Target(), k, **SIZES))
    return jax.jit(train)(agents, jax.vmap(jax.random.key)(jnp.arange(2)))


@pytest.mark.whole
def test_agents_and_keys_map_together(swept):
    _, metrics = swept
    assert metrics["episode_return"].shape == (2, 3)
    assert (metrics["action_kl"][0] < 1e-6).all()
    assert (metrics["action_kl"][1, 1:] > 1e-6).all()


def test_train_is_init_and_repeated_steps(swept, program):
    states, metrics = iterated(*program, jax.random.key(1))
    last = jax.tree.map(lambda x: x[1], swept)
    assert_close(last[0], states[-1], rtol=1e-3, atol=1e-5)
    assert_close(last[1], metrics, rtol=1e-3, atol=1e-4)


def test_a_playground_environment_trains_as_one_of_brax_does(history):
    program = hitmdp_jax.make_train(AGENT, PlaygroundTarget(), episode_length=10, **SIZES)
    assert Target.episode_length == 10
    _, metrics = iterated(*compiled(*program), jax.random.key(0))
    np.testing.assert_allclose(metrics["episode_return"], history[1]["episode_return"], rtol=1e-3)


def test_a_transfer_keeps_what_was_learned_and_restarts_the_rest(program, history):
    old, fresh = history[0][1], program[0](jax.random.key(9))
    new = transfer(old, fresh)
    assert_close((new.learner, new.normalizer, new.key), (old.learner, old.normalizer, old.key))
    assert_close(new.rollout, fresh.rollout)
    assert new.iteration == 1


def test_the_same_seed_gives_the_same_result(program, history):
    states, metrics = iterated(*program, jax.random.key(0))
    assert_close((states, metrics), history, rtol=0)
    other, _ = iterated(*program, jax.random.key(1))
    kernels = (weights(x[-1].learner.params) for x in (states, other))
    assert not any(np.allclose(a, b) for a, b in zip(*kernels, strict=True))


def weights(params):
    """Return the matrices among the parameters: biases start at zero."""
    return [x for x in jax.tree.leaves(params) if x.ndim > 1]


def test_normaliser_equals_the_observations_statistics(program, key):
    """Target draws a new observation in [-1, 1] at every step: mean 0, variance 1/3."""
    init, step = program
    state = init(key)
    for _ in range(40):  # each draws 32 of them, over and over
        state, _ = step(state)
    assert float(state.normalizer.std[0]) == pytest.approx(np.sqrt(1 / 3), abs=0.03)
    assert float(state.normalizer.mean[0]) == pytest.approx(0.0, abs=0.06)


def test_returns_are_nan_until_an_episode_ends_and_then_carried_over(key):
    """Episodes of 40 steps, in iterations of 16: some see no end."""
    sizes = SIZES | {"num_steps": 8 * 128, "episode_length": 40, "stagger": False}
    metrics = jax.jit(lambda k: hitmdp_jax.train(AGENT, Counter(), k, **sizes))(key)[1]
    ended = np.asarray(metrics["episodes"]) > 0
    assert ended.any()
    assert not ended.all()
    np.testing.assert_array_equal(np.isnan(metrics["episode_return"]), ~ended)
    first = int(np.argmax(ended))
    assert first == 2
    assert np.isnan(metrics["recent_return"][:first]).all()
    np.testing.assert_allclose(metrics["recent_return"][first:], 40.0)  # a reward of 1 a step


class Annealed(MOPG):
    """Draws its options at random in the last two of three iterations."""

    def scheduled(self, progress):
        return self.replace(similarity=jnp.where(progress < 0.3, 50.0, 0.0))


class Poison(Target):
    """Numbers are added to the reward and to the observation that a step leads to, from the tenth
    step on in an episode that started below a threshold; to the last observation alone."""

    episode_length = 16

    def __init__(self, threshold, reward=0.0, obs=0.0, last=0.0):
        self.threshold, self.reward, self.obs, self.last = threshold, reward, obs, last

    def reset(self, rng):
        state = super().reset(rng)
        return state.replace(info={"clock": jnp.zeros(()), "start": state.obs})

    def step(self, state, action):
        clock, start = state.info["clock"] + 1, state.info["start"]
        poisoned = start[0] < self.threshold

        def added(after, what):
            return jnp.where(poisoned & (clock >= after), what, 0.0)

        obs = start + added(10, self.obs) + added(16, self.last)
        info = state.info | {"clock": clock}
        reward = 1.0 + added(10, self.reward)
        return state.replace(obs=obs, reward=reward, done=jnp.zeros(()), info=info)


@pytest.fixture(scope="module")
def options():
    """Six runs with options: init(keys), step(poison, states), and three steps as one."""
    agent = Annealed(num_epochs=1, hidden_sizes=(8,))
    sizes = {"num_steps": 3 * 64, "num_envs": 8, "rollout_length": 8, "stagger": False}

    def program(poison):
        return hitmdp_jax.make_train(agent, Poison(**poison), **sizes)

    return compiled(
        lambda keys: jax.vmap(program(NO_POISON)[0])(keys),
        lambda poison, states: jax.vmap(program(poison)[1])(states),
        lambda poison, states: jax.vmap(repeat(program(poison)[1], 3))(states),
    )


NO_POISON = {"threshold": -2.0, "reward": 0.0, "obs": 0.0, "last": 0.0}


def with_options(options, **poison):
    init, step, _ = options
    keys = jax.vmap(jax.random.key)(jnp.arange(6))
    return iterated(init, functools.partial(step, NO_POISON | poison), keys)


@pytest.fixture(scope="module")
def sound(options):
    """The states and the metrics [3, 6] of runs in which nothing goes wrong."""
    return with_options(options)


@pytest.mark.whole
def test_repeated_iterations_sum_up_their_metrics(options, sound):
    states, each = sound
    again, together = options[2](NO_POISON, states[0])
    assert_close(again, states[-1], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(together["option_steps"], each["option_steps"].sum(0))
    np.testing.assert_allclose(together["episodes"], each["episodes"].sum(0))
    total = np.nansum(each["episode_return"] * each["episodes"], axis=0)
    np.testing.assert_allclose(
        together["episode_return"], total / each["episodes"].sum(0), rtol=1e-5
    )
    np.testing.assert_allclose(together["value_loss"], each["value_loss"].mean(0), rtol=1e-5)


@pytest.mark.parametrize(
    ("poison", "cause"),
    [
        ({"reward": np.nan}, "reward"),
        ({"obs": np.nan}, "observation"),
        ({"obs": np.inf}, "observation"),
        # A state that no policy sees: the time limit ends the episode there.
        ({"last": np.nan}, "observation"),
        # Its square overflows; clipped, it would be like any other to the policy.
        ({"obs": 1e30}, "observation statistics"),
    ],
)
def test_a_run_that_is_not_finite_keeps_its_last_finite_state_and_harms_no_other(
    options, sound, poison, cause
):
    states, metrics = with_options(options, threshold=-0.9, **poison)
    _, once, _, thrice = states
    lost = np.asarray(thrice.diverged) > 0
    assert lost.any()
    assert not lost.all()
    assert set(np.asarray(thrice.diverged)[lost]) == {2}
    assert {CAUSES[i] for i in np.asarray(thrice.cause)[lost]} == {cause}
    told = np.asarray(metrics["diverged"])
    assert told[:, lost].all(axis=1).tolist() == [False, True, True]
    assert not told[:, ~lost].any()
    assert np.isnan(metrics["value_loss"][1:, lost]).all()
    assert (np.asarray(metrics["option_steps"])[1:, lost] == 0).all()
    # A lost seed's parameters are those after its only finite iteration. The others are bit for
    # bit what they are where nobody diverges.
    learned = ((s.learner, s.normalizer) for s in (once, thrice, sound[0][-1]))
    learners = map(jax.tree.leaves, learned)
    for one, three, where_nobody in zip(*learners, strict=True):
        np.testing.assert_array_equal(one[lost], three[lost])
        assert np.isfinite(three).all()
        np.testing.assert_array_equal(where_nobody[~lost], three[~lost])


@pytest.mark.parametrize("name", ["loss", "action_entropy", "termination"])
def test_an_algorithms_metric_that_is_not_finite_is_divergence(history, name):
    """Those that are always measured; a loss is that of the gradients, whatever its parts."""
    states, metrics = history
    one = jax.tree.map(lambda x: x[0], metrics)
    for learning, cause in ({name: 1.0}, "none"), ({name: np.nan}, describe(name).cause):
        seen = {c: watched(jax.tree.map(jnp.asarray, learning), c) for c in ("loss", "policy")}
        state, told = freeze_diverged(states[0], states[1], one, seen)
        assert CAUSES[int(state.cause)] == cause
        assert int(state.diverged) == (0 if cause == "none" else 1)
        assert bool(told["diverged"]) == (cause != "none")


def test_a_replay_is_beside_the_learner_and_holds_what_the_environments_showed():
    """The last 64 observations, raw; and a seed that diverges leaves it alone."""
    agent = Remembering(num_epochs=1, hidden_sizes=(8,))
    init, step = compiled(*hitmdp_jax.make_train(agent, Target(), **SIZES))
    state = init(jax.random.key(0))
    for _ in range(2):
        state, metrics = step(state)
    obs, reward = state.replay.data
    assert obs.shape == (64, 1)
    assert int(state.replay.size) == 64
    assert (np.abs(obs) <= 1).all()
    assert obs.std() == pytest.approx(np.sqrt(1 / 3), abs=0.1)  # normalised it would be 1
    assert float(metrics["remembered"]) == pytest.approx(float(reward.mean()), abs=0.5)
    lost, _ = freeze_diverged(state, state, metrics, {"reward": jnp.array(np.nan)})
    assert lost.replay is state.replay


def test_fresh_states_are_drawn_for_all_trainings_when_they_are_due(key):
    """Every other iteration of 16 actions; under `vmap`, too, a condition and no choice."""
    init, step = hitmdp_jax.make_train(AGENT, Target(), **SIZES)

    @jax.jit
    def pools(keys):
        states = jax.vmap(init)(keys)

        def once(states, _):
            states, _ = jax.vmap(step)(states)
            return states, states.rollout.env.pool.obs

        return jax.lax.scan(once, states, length=3)[1]

    first, second, third = pools(jax.random.split(key))
    np.testing.assert_array_equal(first, second)
    assert not np.isclose(second, third).any(axis=1).all()
    states = jax.eval_shape(jax.vmap(init), jax.random.split(key))
    assert " cond[" in str(jax.make_jaxpr(jax.vmap(step))(states))


class Lasting(Counter):
    """Which says how long its episodes are at least."""

    episode_length = shortest_episode = 50


def test_a_task_of_long_episodes_draws_few_initial_states_and_uses_none_twice(key):
    """A state for each environment every third iteration of 16 actions, and 15 iterations."""
    init, step = hitmdp_jax.make_train(AGENT, Lasting(), **SIZES)

    @jax.jit
    def serials(key):
        def once(state, _):
            state, _ = step(state)
            return state, state.rollout.env.env.obs[:, 1]

        state, seen = jax.lax.scan(once, init(key), length=15)
        return state.rollout.env.pool.obs, seen

    pool, seen = serials(key)
    assert len(pool) == SIZES["num_envs"]
    of_each = [set(serials.tolist()) for serials in seen.T]
    assert min(map(len, of_each)) >= 4  # 240 actions are more than four episodes
    assert len(set().union(*of_each)) == sum(map(len, of_each))


def test_fresh_states_are_as_many_as_episodes_may_end():
    assert [shortest_episode(env) for env in (Counter(), Lasting())] == [4, 50]
    assert shortest_episode(Lasting(), episode_length=20) == 20
    assert shortest_episode(ActionRepeat(Lasting(), 2)) == 25
    for rollout_length, shortest, period, size in (
        (128, 4, 1, 512),  # of 16 environments: a quarter of the actions
        (2, 4, 16, 128),
        (128, 32, 1, 64),
        (128, 1000, 7, 16),  # 896 actions, in which no environment ends twice
        (128, 100, 1, 32),
    ):
        assert pool_period(rollout_length, shortest) == period
        assert usual_pool_size(16, rollout_length, shortest) == size


@pytest.mark.parametrize("compile_init", [False, True])
def test_a_step_may_be_given_the_memory_of_the_state(program, compile_init):
    """Donation: XLA refuses it where two fields share their memory."""
    init, _ = hitmdp_jax.make_train(AGENT, Counter(), **SIZES)
    given = {"learning_rate": jnp.asarray(1e-3)}
    state = (jax.jit(init) if compile_init else init)(jax.random.key(0), given)
    donated = jax.jit(lambda state: jax.tree.map(lambda x: x, state), donate_argnums=0)
    jax.block_until_ready(donated(state))
    assert not given["learning_rate"].is_deleted()


def test_the_agent_that_acts_is_the_scheduled_one(sound):
    """Options are drawn at random once the similarity has been annealed to zero."""
    durations = 64 / np.asarray(sound[1]["option_activations"]).sum(-1)
    assert (durations[0] > 3.0).all()
    assert (durations[1:] < 2.0).all()


def test_an_agents_class_is_not_an_agent():
    with pytest.raises(UsageError, match=r"agent is the class MOPG: pass an agent, MOPG\(\)"):
        hitmdp_jax.make_train(MOPG, Target(), **SIZES)


def test_iterations_cover_the_steps():
    assert num_iterations(1_000_000, 16, 128) == 489
    assert num_iterations(2048, 16, 128) == 1


@pytest.mark.parametrize(
    ("sizes", "sentence"),
    [
        ({"num_envs": 3, "rollout_length": 100}, "3 = 300 is not divisible by minibatch_size = 64"),
        ({"num_envs": 0}, "num_envs = 0 must be a positive whole number"),
        ({"rollout_length": -5}, "rollout_length = -5 must be a positive whole number"),
        ({"rollout_length": "a"}, "rollout_length = a must be a positive whole number"),
        ({"num_envs": 2.5}, "num_envs = 2.5 must be a positive whole number"),
        ({"num_envs": True}, "num_envs = True must be a positive whole number"),
    ],
)
def test_sizes_that_do_not_fit_are_explained(sizes, sentence):
    with pytest.raises(UsageError, match=sentence):
        hitmdp_jax.make_train(MOPG(), Target(), num_steps=10, **sizes)


class Noting(PPO):
    """PPO that tells what its update saw: the mean reward and the mean of the first entry."""

    def update(self, state, batch, key):
        state, metrics = super().update(state, batch, key)
        seen = batch.normalized().obs[..., 0].mean()
        return state, metrics | {"seen_reward": batch.reward.mean(), "seen": seen}


@pytest.mark.parametrize("normalize", [True, False])
def test_rewards_are_scaled_and_observations_left_raw_for_learning_alone(normalize):
    """`Counter` pays 1 a step and observes the steps of its episode so far, 0 to 4."""
    agent = Noting(num_epochs=1, hidden_sizes=(8,), normalize_observations=normalize)
    init, step = hitmdp_jax.make_train(
        agent, Counter(), num_steps=256, num_envs=8, rollout_length=16
    )

    @jax.jit
    def train(scale):
        state = init(jax.random.key(0), {"reward_scale": scale})
        return jax.lax.scan(lambda state, _: step(state), state, length=2)

    state, metrics = train(jnp.float32(0.1))
    np.testing.assert_allclose(metrics["step_reward"], 1.0)
    np.testing.assert_allclose(metrics["seen_reward"], 0.1, rtol=1e-6)
    np.testing.assert_allclose(metrics["recent_return"][-1], 5.0)
    raw = float(state.normalizer.mean[0])
    assert 1.5 < raw < 2.5
    first, second = metrics["seen"]
    assert first == pytest.approx(raw, abs=0.3)  # of nothing seen yet, the mean is taken for 0
    assert second == pytest.approx(0.0 if normalize else raw, abs=0.3)
