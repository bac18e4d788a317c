"""What a training takes over from another one, array by array."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import OC, PPO
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.normalization import count_of, initial_statistics, update_statistics
from hitmdp_jax.training.policy import Policy
from hitmdp_jax.training.warm_start import PARTS
from tests.probes import Counter, Target

AGENT = PPO(hidden_sizes=(8,), num_epochs=1, minibatch_size=128)
SIZES = {"num_steps": 128, "num_envs": 8, "rollout_length": 16}
SEEN = np.linspace(-3.0, 5.0, 1000, dtype=np.float32)[:, None]


def state_of(agent, env, seed, **options):
    init, _ = hitmdp_jax.make_train(agent, env, **SIZES, **options)
    return init(jax.random.key(seed))


@pytest.fixture(scope="module")
def source():
    """A training that has seen a thousand observations, and whose optimiser has made a step."""
    state = state_of(AGENT, Target(), 1)
    moments = jax.tree.map(lambda x: x + 1, state.learner.opt_state)
    return state.replace(
        learner=state.learner.replace(opt_state=moments),
        normalizer=update_statistics(initial_statistics(1), SEEN),
    )


@pytest.fixture(scope="module")
def policy(source):
    return Policy(AGENT.bind(source.spec), source.learner.params, source.normalizer)


@pytest.fixture(scope="module")
def fresh():
    return state_of(AGENT, Target(), 2)


def same(one, other):
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return all(np.array_equal(x, y) for x, y in pairs)


def parts_of(state):
    params = dict(state.learner.params)
    critic = params.pop("critic")
    optimizer = state.learner.opt_state
    return dict(zip(PARTS, (params, critic, state.normalizer, optimizer), strict=True))


@pytest.mark.parametrize("parts", [None, *((part,) for part in PARTS[:3]), ("policy", "critic")])
def test_the_parts_that_are_asked_for_are_taken_and_no_others(parts, source, fresh):
    own = state_of(AGENT, Target(), 2, init_from=source, init_parts=parts)
    for part, x in parts_of(own).items():
        of = source if part in (parts or PARTS) else fresh
        assert same(x, parts_of(of)[part]), part
    assert same(own.rollout, fresh.rollout)
    assert own.iteration == 0


def test_a_policy_has_no_optimiser_which_is_told(policy, source, fresh, capsys):
    own = state_of(AGENT.replace(learning_rate=1e-5), Target(), 2, init_from=policy)
    found, wanted = parts_of(own), parts_of(source) | {"optimizer": fresh.learner.opt_state}
    assert all(same(found[part], wanted[part]) for part in PARTS)
    assert capsys.readouterr().err == "warning: init_from: starting anew: optimizer\n"


def test_what_fits_exactly_is_taken_without_a_word(source, capsys):
    state_of(AGENT, Target(), 2, init_from=source)
    assert capsys.readouterr().err == ""


def test_another_task_takes_the_arrays_that_fit_and_names_the_others(source, capsys):
    fresh = state_of(AGENT, Counter(), 2)
    own = state_of(AGENT, Counter(), 2, init_from=source)
    said = capsys.readouterr().err
    assert "what it observes is new, arrays [2] instead of arrays [1]" in said
    for path, x in jax.tree.leaves_with_path(own.learner.params):
        name = jax.tree_util.keystr(path, simple=True, separator="/")
        reads = name.endswith("body/input_0/kernel")  # the only arrays of the observation's size
        assert (name in said) == reads
        of = fresh if reads else source
        leaves = dict(jax.tree.leaves_with_path(of.learner.params))
        np.testing.assert_array_equal(x, leaves[path], name)
    assert same(own.normalizer, fresh.normalizer)
    assert same(own.learner.opt_state, fresh.learner.opt_state)
    assert "normalizer, optimizer" in said


def test_a_target_network_is_the_network_that_was_taken():
    agent = OC(hidden_sizes=(8,))
    before = state_of(agent, Target(), 1)
    policy = Policy(agent.bind(before.spec), before.learner.params, before.normalizer)
    own = state_of(agent, Target(), 2, init_from=policy)
    assert same(own.learner.target.params, before.learner.params)


def test_training_goes_on_from_a_policy_and_counts_on(policy):
    """With a learning rate of 0 nothing but the normaliser changes, which takes 128 steps in."""
    agent = AGENT.replace(learning_rate=0.0, normalize_values=False)

    def run(policy):
        return hitmdp_jax.train(agent, Target(), jax.random.key(3), **SIZES, init_from=policy)[0]

    shifted = policy.replace(params=jax.tree.map(lambda x: x + 1.0, policy.params))
    both = jax.tree.map(lambda *x: jnp.stack(x), policy, shifted)
    states = jax.jit(jax.vmap(run))(both)
    assert same(states.learner.params, both.params)
    np.testing.assert_array_equal(count_of(states.normalizer), [1128, 1128])
    lowest, highest = SEEN.mean() * 1000 / 1128 - 128 / 1128, SEEN.mean()
    assert lowest < states.normalizer.mean[0, 0] < highest  # the task shows numbers in [-1, 1]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"init_from": 3}, "init_from is a int: pass a Policy"),
        ({"init_parts": ("polcy",)}, "did you mean 'policy'?"),
        ({"init_parts": ()}, "must name some of policy, critic"),
    ],
)
def test_what_cannot_be_begun_with_is_explained(policy, arguments, sentence):
    with pytest.raises(UsageError) as error:
        state_of(AGENT, Target(), 2, **{"init_from": policy} | arguments)
    assert sentence in str(error.value)


def test_a_source_of_which_nothing_fits_is_explained(policy):
    with pytest.raises(UsageError, match=r"nothing fits.*observes arrays \[1\].*has arrays \[2\]"):
        state_of(PPO(hidden_sizes=(4,)), Counter(), 2, init_from=policy)
