import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from brax.training.acme.running_statistics import NestedMeanStd

import hitmdp_jax
from hitmdp_jax.agents import AGENTS, MOPG, PPO
from hitmdp_jax.envs.vector import VectorEnv
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.normalization import initial_statistics, update_statistics
from hitmdp_jax.learning.rollout import RolloutState, collect
from hitmdp_jax.runs import checkpoint
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress
from hitmdp_jax.runs.checkpoint_items import policy_of
from hitmdp_jax.runs.policy import Policy, load_all
from hitmdp_jax.runs.saving import extract
from tests.probes import Target, spec_of_sizes, untrained

AGENT = MOPG(num_epochs=1, num_options=3, learning_rate=1e-3)


@pytest.fixture(scope="module")
def states():
    """Two seeds, as after an iteration."""
    return after_an_iteration(AGENT, 2)


def after_an_iteration(agent, seeds):
    """Return a state [S, ...] with parameters that no program has to draw."""
    state, draw = untrained(agent, seeds, Target()), np.random.default_rng(0)
    params = jax.tree.map(lambda x: draw.normal(size=x.shape).astype(x.dtype), state.learner.params)
    first = jax.tree.map(lambda x: np.stack([x] * seeds), initial_statistics(1))
    seen = first.replace(
        mean=first.mean + np.float32(0.5) + np.arange(seeds, dtype=np.float32)[:, None]
    )
    learner = state.learner.replace(params=params)
    return state.replace(learner=learner, normalizer=seen, iteration=state.iteration + 1)


@pytest.fixture(scope="module")
def saved(states, tmp_path_factory):
    run_dir = tmp_path_factory.mktemp("saved") / "run"
    hitmdp_jax.save(run_dir, AGENT, states)
    return run_dir


def test_what_the_library_trained_is_loaded_as_it_was(saved, states):
    policy = hitmdp_jax.load(saved, seed=1)
    assert policy.agent == AGENT.bind(states.spec)
    jax.tree.map(lambda x, y: np.testing.assert_array_equal(x, y[1]), policy.params,
                 states.learner.params)  # fmt: skip
    np.testing.assert_array_equal(policy.normalizer.mean, states.normalizer.mean[1])


def test_a_single_state_is_saved_too(states, tmp_path):
    one = jax.tree.map(lambda x: x[0], states)
    hitmdp_jax.save(tmp_path / "run", AGENT, one)
    assert hitmdp_jax.load(tmp_path / "run").normalizer.mean.shape == (1,)
    with pytest.raises(UsageError, match="already holds a run"):
        hitmdp_jax.save(tmp_path / "run", AGENT, one)
    hitmdp_jax.save(tmp_path / "run", AGENT, one, overwrite=True)


def test_a_policy_is_a_pytree_that_jits_and_vmaps(saved):
    iteration, everyone = load_all(saved)
    assert iteration == 1
    keys = jax.random.split(jax.random.key(1), 2)
    obs = jnp.ones(1)

    def act(params, normalizer, key):
        policy = everyone.replace(params=params, normalizer=normalizer)
        return policy.act(obs, policy.initial_memory(key), key, deterministic=True)[0]

    together = jax.jit(jax.vmap(act))(everyone.params, everyone.normalizer, keys)
    for seed, key in enumerate(keys):
        policy = hitmdp_jax.load(saved, seed)
        alone, _ = jax.jit(lambda p, k: p.act(obs, p.initial_memory(k), k, True))(policy, key)
        np.testing.assert_allclose(together[seed], alone, rtol=1e-5)


class Whole(Target):
    """`Target` whose observation is a whole number."""

    def reset(self, rng):
        state = super().reset(rng)
        return state.replace(obs=jnp.round(5 * state.obs).astype(jnp.int8))


def test_what_a_policy_learned_from_is_what_it_acts_on(states):
    """A rollout and a trained policy see the same numbers for the same observations."""
    one = jax.tree.map(lambda x: x[0], states)
    env = VectorEnv(Whole(), 8, pool_size=4)

    def run(key):
        memory = AGENT.initial_memory(key, (8,))
        start = RolloutState(env.reset(key), memory)
        agent = AGENT.bind(one.spec)
        args = agent, one.learner.params, one.normalizer, env, start, key, 2
        _, batch, _ = collect(*args)
        policy = Policy(agent, one.learner.params, one.normalizer)
        return batch.normalized().obs, policy.normalized(batch.obs), batch.obs

    learned_from, acted_on, obs = jax.jit(run)(jax.random.key(3))
    assert obs.dtype == jnp.int8
    np.testing.assert_array_equal(learned_from, acted_on)
    assert len(np.unique(learned_from)) > 2


def test_the_best_checkpoint_is_the_one_of_the_highest_return(states, tmp_path):
    run_dir = tmp_path / "run"
    hitmdp_jax.save(run_dir, AGENT, states)
    checkpoints = Checkpoints(run_dir)
    for i, recent_return in enumerate([5, 9, 1, 2, 3], start=2):
        seen = states.normalizer.replace(mean=states.normalizer.mean + i)
        checkpoints.save(Progress(i, 0, states.replace(normalizer=seen)), recent_return)
    checkpoints.close()
    extract(run_dir, tmp_path / "one.policy", checkpoint="best")
    for policy in (
        hitmdp_jax.load(run_dir, checkpoint="best"),
        hitmdp_jax.load(tmp_path / "one.policy"),
        hitmdp_jax.load(tmp_path / "one.policy", checkpoint="best", task=0),
    ):
        np.testing.assert_array_equal(policy.normalizer.mean, states.normalizer.mean[0] + 3)


def test_observations_of_another_size_are_explained(saved):
    policy = hitmdp_jax.load(saved)
    memory = policy.initial_memory(jax.random.key(0))
    with pytest.raises(UsageError, match=r"obs has shape \(3,\); its last axes must be \(1,\)"):
        policy.act(jnp.zeros(3), memory, jax.random.key(0))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"seed": 2}, "holds 0 to 1"),
        ({"checkpoint": 5}, "holds no checkpoint 5; it holds 1"),
        ({"checkpoint": "newst"}, "holds no checkpoint newst"),
    ],
)
def test_what_is_not_there_is_explained(saved, arguments, sentence):
    with pytest.raises(UsageError, match=sentence):
        hitmdp_jax.load(saved, **arguments)


def test_a_checkpoint_of_another_algorithm_is_explained(saved, tmp_path, states):
    run_dir = tmp_path / "run"
    hitmdp_jax.save(run_dir, AGENT, states)
    settings = yaml.safe_load((run_dir / "config.yaml").read_text())
    for change in ({"name": "ppo"}, {"name": "mopg", "num_options": 7}):
        settings["algo"] = change
        (run_dir / "config.yaml").write_text(yaml.safe_dump(settings))
        with pytest.raises(UsageError, match="does not fit the algorithm"):
            hitmdp_jax.load(run_dir)


def test_what_cannot_be_saved_is_explained(states, tmp_path):
    with pytest.raises(UsageError, match="pass the TrainState"):
        hitmdp_jax.save(tmp_path / "a", AGENT, states.learner)
    swept = jax.vmap(lambda rate: AGENT.replace(learning_rate=rate))(jnp.array([1e-3, 1e-4]))
    with pytest.raises(UsageError, match="reward_scale has 2 values"):
        hitmdp_jax.save(tmp_path / "b", swept, states)
    with pytest.raises(UsageError, match="is not a run's folder"):
        hitmdp_jax.load(tmp_path / "c")
    assert not (tmp_path / "b").exists()


def test_an_agent_with_traced_hyperparameters_is_saved_with_its_numbers(states, tmp_path):
    agent = PPO(learning_rate=jnp.float32(1e-3), num_epochs=1)
    hitmdp_jax.save(tmp_path / "run", agent, after_an_iteration(agent, 1))
    assert hitmdp_jax.load(tmp_path / "run").agent.learning_rate == pytest.approx(1e-3)


def test_a_policy_is_copied_out_of_a_run(saved, tmp_path):
    path = tmp_path / "one.policy"
    extract(saved, path, seed=1)
    policy, original = hitmdp_jax.load(path), hitmdp_jax.load(saved, seed=1)
    jax.tree.map(np.testing.assert_array_equal, policy, original)
    assert path.stat().st_size < 2**20
    for wrong in ({"seed": 0}, {"checkpoint": 7}):
        with pytest.raises(UsageError, match=r"seed = 0 is not in|holds no checkpoint 7; it holds"):
            hitmdp_jax.load(path, **wrong)
    with pytest.raises(UsageError, match="seed = 5 is not in the run"):
        extract(saved, path, seed=5)
    with pytest.raises(UsageError, match=r"must end with .policy"):
        extract(saved, tmp_path / "two")


@pytest.mark.parametrize("agent", [kind(hidden_sizes=(8,)) for kind in AGENTS.values()])
def test_every_algorithms_policy_goes_through_a_file(agent, tmp_path):
    hitmdp_jax.save(tmp_path / "run", agent, untrained(agent, 2))
    extract(tmp_path / "run", tmp_path / "x.policy", seed=1)
    one, original = hitmdp_jax.load(tmp_path / "x.policy"), hitmdp_jax.load(tmp_path / "run", 1)
    jax.tree.map(np.testing.assert_array_equal, one, original)


def test_a_changed_bit_of_a_policys_file_is_noticed(saved, tmp_path):
    path = tmp_path / "one.policy"
    extract(saved, path)
    whole = path.read_bytes()
    for place in np.random.default_rng(0).integers(len(whole), size=50):
        changed = bytes([whole[place] ^ 1])
        path.write_bytes(whole[:place] + changed + whole[place + 1 :])
        with pytest.raises(UsageError, match="cannot be read"):
            hitmdp_jax.load(path)


def test_the_normaliser_of_a_loaded_policy_goes_on(tmp_path):
    """Of a folder, of a file and of both as older packages wrote them, who noted no count."""
    first, second = np.random.default_rng(0).normal(3.0, 2.0, (2, 2048, 1)).astype(np.float32)
    state = after_an_iteration(AGENT, 1)
    own = update_statistics(initial_statistics(1), first)
    state = state.replace(normalizer=jax.tree.map(lambda x: x[None], own))
    whole = policy_of(state)
    without = {name: x for name, x in whole.items() if name != "count"}
    for name, kept in (("run", whole), ("old", without)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(checkpoint, "policy_of", lambda state, kept=kept: kept)
            hitmdp_jax.save(tmp_path / name, AGENT, state)
        extract(tmp_path / name, tmp_path / f"{name}.policy")
    alone = update_statistics(own, second)
    for name in ("run", "run.policy", "old", "old.policy"):
        policy = hitmdp_jax.load(tmp_path / name)
        on = update_statistics(policy.normalizer, second)
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5), on, alone)


def test_a_policy_says_its_options_and_what_it_expects(saved):
    """The value is the mean of Q over the options' probabilities, by the critic itself."""
    policy, obs, memory = hitmdp_jax.load(saved), jnp.array([0.3]), jnp.int32(1)
    probs, value = policy.option_probs(obs, memory), policy.value(obs, memory)
    assert probs.sum() == pytest.approx(1.0)
    every = [policy.agent.q(policy.params, policy.normalized(obs), jnp.int32(k)) for k in range(3)]
    assert value == pytest.approx(float(probs @ jnp.stack(every)), rel=1e-4, abs=1e-6)


def test_a_policy_of_raw_observations_sees_them_as_they_are():
    agent = PPO(hidden_sizes=(2,), normalize_observations=False, spec=spec_of_sizes(2, 1))
    statistics = NestedMeanStd(np.ones(2, np.float32), np.full(2, 3.0, np.float32))
    policy = Policy(agent, {}, statistics)
    np.testing.assert_array_equal(policy.normalized(np.array([70, -2])), [70.0, -2.0])
    usual = policy.replace(agent=agent.replace(normalize_observations=True))
    np.testing.assert_allclose(usual.normalized(np.array([70, -2])), [10.0, -1.0])  # clipped
