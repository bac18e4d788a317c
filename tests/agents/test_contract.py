"""What every agent owes, whichever it is."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import AGENTS, PPOGRU, SAC
from hitmdp_jax.agents.base import hyperparameters_of
from hitmdp_jax.agents.option_agent import ClippedOptionAgent
from hitmdp_jax.envs.spec import Box, Observation, Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.metrics import REWARD_TERM, describe
from tests.agents.option_batches import random_params
from tests.probes import Target, spec_of_sizes
from tests.programs import compiled, shapes_of_an_iteration, types

SIZES = {"num_envs": 8, "rollout_length": 16}


# One gradient step an iteration instead of 2 epochs of 2: smaller iterations, and more of them.
SINGLE_STEP = {"num_envs": 8, "rollout_length": 4}


@pytest.fixture(params=sorted(AGENTS))
def name(request):
    return request.param


BY_DEFAULT = ("mopg", "ppo", "hit_sac")  # whose learning is tried in every run of the tests
LEARNERS = [
    pytest.param(x, marks=() if x in BY_DEFAULT else pytest.mark.whole) for x in sorted(AGENTS)
]


@pytest.fixture(params=LEARNERS)
def learner(request):
    return request.param


@pytest.fixture
def agent(name):
    return make_agent(name)


OFF_POLICY = {"batch_size": 32, "replay_size": 1024, "warmup_steps": 64}


def make_agent(name):
    agent = AGENTS[name](spec=spec_of_sizes(5, 2))
    if isinstance(agent, SAC):
        return agent.replace(**OFF_POLICY)
    return agent.replace(num_epochs=2) if hasattr(agent, "num_epochs") else agent


@functools.cache
def params_of(name):
    """Return parameters that no program has to draw."""
    return random_params(make_agent(name))


@pytest.mark.parametrize("batch_shape", [(), (3,), (2, 3)])
def test_act_takes_any_batch_shape(agent, name, key, batch_shape):
    """Shapes alone are asked for, so nothing is compiled."""

    def act(params, key):
        memory = agent.initial_memory(key, batch_shape)
        obs = jnp.ones((*batch_shape, 5))
        value = agent.value_of(params, obs, memory)
        return value, memory, *agent.act(params, obs, memory, key)

    value, memory, action, new_memory, _ = jax.eval_shape(act, params_of(name), key)
    assert (value.shape, action.shape) == (batch_shape, (*batch_shape, 2))
    assert jax.tree.map(jnp.shape, memory) == jax.tree.map(jnp.shape, new_memory)


@functools.cache
def acted(name):
    """Return an agent's likeliest actions in 2 x 3 states by each of two keys, the options that it
    draws there and their probabilities, by one program."""
    agent = make_agent(name)

    @compiled
    def run(params, key):
        memory = agent.initial_memory(key, (2, 3))
        obs = jax.random.normal(key, (2, 3, 5))

        def likeliest(key):
            return agent.act(params, obs, memory, key, deterministic=True)[0]

        _, _, record = agent.act(params, obs, memory, key)
        actions = jax.vmap(likeliest)(jax.random.split(key))
        return actions, agent.option_of(record), agent.option_probs(params, obs, memory)

    return run(params_of(name), jax.random.key(0))


def test_deterministic_actions_repeat(name):
    actions, _, _ = acted(name)
    np.testing.assert_array_equal(*actions)


def test_iteration_keeps_structure_shapes_and_types_and_reports_what_has_a_meaning(name):
    before, after, metrics = shapes_of_an_iteration(name)
    assert jax.tree.structure(before) == jax.tree.structure(after)
    assert [(x.shape, x.dtype) for x in jax.tree.leaves(before)] == [
        (x.shape, x.dtype) for x in jax.tree.leaves(after)
    ]
    assert {"episode_return", "episode_length", "episodes"} <= metrics.keys()
    unknown = {metric for metric in metrics if describe(metric) is REWARD_TERM}
    assert unknown == {"reward/near"}


def test_types_do_not_depend_on_the_default_of_jax(name):
    """On a task of one's own, of which that default makes 64 bits."""
    with jax.enable_x64(True):
        before, after, metrics = shapes_of_an_iteration.__wrapped__(name)
    assert types(before) == types(after)
    default, _, metrics_by_default = shapes_of_an_iteration(name)
    assert types(metrics) == types(metrics_by_default)
    wide, narrow = (  # without the task's state
        types(x.replace(rollout=x.rollout.memory)) for x in (before, default)
    )
    assert wide == narrow


@functools.cache
def learnt(name):
    """Return the first parameters, the last ones and the metrics of a run that does not learn and
    of one that does, by one program.

    Separate networks for K options see a part of the samples each and take twice the iterations.
    """
    agent = make_agent(name).replace(hidden_sizes=(16,))
    sizes, iterations = (SIZES, 40) if hasattr(agent, "num_epochs") else (SINGLE_STEP, 400)
    if isinstance(agent, ClippedOptionAgent | SAC):  # SAC makes a gradient step for each new step
        iterations = 80
    num_steps = iterations * sizes["num_envs"] * sizes["rollout_length"]

    def run(rate):
        init, step = hitmdp_jax.make_train(
            agent.replace(learning_rate=rate),
            Target(),
            num_steps=num_steps,
            reset_pool_size=128,
            **sizes,
        )
        first = init(jax.random.key(0))
        last, metrics = jax.lax.scan(lambda state, _: step(state), first, length=iterations)
        return first.learner.params, last.learner.params, metrics

    return compiled(jax.vmap(run))(np.array([0.0, 3e-3]))


def test_metrics_are_finite(learner):
    for metric, value in learnt(learner)[2].items():
        assert np.isfinite(value).all(), metric


def test_float_hyperparameters_are_leaves_and_the_rest_is_static(agent):
    floats = [f for f in hyperparameters_of(agent) if isinstance(f.default, float)]
    assert len(jax.tree.leaves(agent)) == len(floats)
    clipped = {"clip_eps"} if hasattr(agent, "num_epochs") else set()
    assert {"learning_rate", "gamma"} | clipped <= {f.name for f in floats}


def unscaled(params):
    """Leave out what changes whatever the learning rate: the end of a warm-up, and what follows
    the returns and changes no value."""
    params = {name: x for name, x in params.items() if name != "uniform"}
    critic = params.get("critic", {})
    if "scale" not in critic:
        return params
    return params | {"critic": {"body": critic["body"]}}


def test_two_learning_rates_train_in_one_program(learner):
    untrained, trained, _ = (unscaled(x) for x in learnt(learner))
    same = jax.tree.map(lambda x, y: np.allclose(x[0], y[0], atol=1e-6), trained, untrained)
    moved = jax.tree.map(lambda x, y: not np.allclose(x[1], y[1], atol=1e-6), trained, untrained)
    assert all(jax.tree.leaves(same))
    assert any(jax.tree.leaves(moved))


def test_learns_to_hit_the_target(learner):
    """The best return is 1; the first policy's is 1 - 1/3 - its variance, at most 0.3."""
    returns = learnt(learner)[2]["episode_return"][1].reshape(40, -1).mean(1)
    assert returns[:3].mean() < 0.55
    assert returns[-5:].mean() > 0.75


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"learning_rate": -1.0}, "learning_rate = -1.0 must be a finite number from 0"),
        ({"learning_rate": float("inf")}, "learning_rate = inf must be a finite number from 0"),
        ({"learning_rate": "a"}, "learning_rate = a must be a finite number from 0"),
        ({"learning_rate": None}, "learning_rate = None must be a finite number from 0"),
        ({"learning_rate": True}, "learning_rate = True must be a finite number from 0"),
        ({"gamma": 1.5}, "gamma = 1.5 must be a number from 0 to 1"),
        ({"gamma": float("nan")}, "gamma = nan must be a number from 0 to 1"),
        ({"hidden_sizes": (64, -1)}, "must be a list of positive whole numbers"),
        ({"hidden_sizes": 64}, "hidden_sizes = 64 must be a list of positive whole numbers"),
        ({"hidden_sizes": ()}, "must be a list of positive whole numbers"),
        ({"activation": "rely"}, "did you mean 'relu'"),
        ({"bootstrap_on_truncation": 1}, "bootstrap_on_truncation = 1 must be true or false"),
    ],
)
def test_bad_hyperparameters_are_explained(agent, change, sentence):
    with pytest.raises(UsageError, match=sentence):
        agent.replace(**change)


def test_bad_sizes_are_explained(agent):
    """Every whole number of an agent, whichever it has."""
    for field in hyperparameters_of(agent):
        if isinstance(field.default, int) and not isinstance(field.default, bool):
            sentence = f"{field.name} = 0 must be a positive whole number"
            with pytest.raises(UsageError, match=sentence):
                agent.replace(**{field.name: 0})


def test_executed_options_and_their_probabilities_agree(agent, name):
    """An option that was executed is an index, and its probability is not zero."""
    _, option, probs = acted(name)
    if option is None:
        assert probs is None
        return
    assert option.shape == (2, 3)
    assert probs.shape == (2, 3, agent.num_options)
    np.testing.assert_allclose(probs.sum(-1), 1.0, rtol=1e-5)
    assert (np.take_along_axis(probs, option[..., None], axis=-1) > 0).all()


def test_actions_can_be_asked_of_every_option_at_once(agent, name):
    """What has no options has one policy, whichever is named; with a memory it says of none."""
    if isinstance(agent, PPOGRU):
        assert agent.policy({}, jnp.ones((7, 1, 5)), jnp.arange(3)) is None
        return

    def means(params):
        every = jnp.arange(getattr(agent, "num_options", 3))
        policies = agent.policy(params, jnp.ones((7, 1, 5)), every)
        return policies.mean()

    found = jax.eval_shape(means, params_of(name))
    assert found.shape == (7, getattr(agent, "num_options", 1), 2)


PARTED = Spec(Observation((5,), parts=(("body", (3,)), ("goal", (2,)))), Box.unlimited(2))
BLIND = [  # who reads the body alone, and what of a policy does not see the goal then
    (("action_reads",), {"action"}),
    (("master_reads", "critic_reads"), {"option_probs", "value"}),  # the critic is OC's master
]


@pytest.mark.parametrize(("readers", "blind"), BLIND)
def test_nothing_depends_on_what_is_not_read(name, readers, blind):
    known = {field.name for field in hyperparameters_of(AGENTS[name])}
    agent = AGENTS[name](hidden_sizes=(8,), activation="tanh", spec=PARTED)
    # PPO-GRU's critic reads what is remembered, too; SAC's the action that the policy takes.
    if (name == "ppo_gru" or isinstance(agent, SAC)) and "critic_reads" in readers:
        readers, blind = (*readers, "action_reads"), {*blind, "action"}
    agent = agent.replace(**dict.fromkeys(known.intersection(readers), ("body",)))
    params = random_params(agent)

    def said(obs):
        memory, key = agent.initial_memory(jax.random.key(0)), jax.random.key(1)
        action, memory, _ = agent.act(params, obs, memory, key, True)
        return {
            "action": action,
            "option_probs": agent.option_probs(params, obs, jax.lax.stop_gradient(memory)),
            "value": agent.value_of(params, obs, memory),
        }

    for what, slopes in compiled(jax.jacobian(said))(jnp.full(5, 0.3)).items():
        if slopes is not None:
            moves = np.abs(slopes.reshape(-1, 5)).max(0) > 1e-6
            assert moves.tolist() == 3 * [True] + 2 * [what not in blind], what


def test_parameters_are_of_what_is_read(name):
    sizes = {
        len(reads): sum(x.size for x in jax.tree.leaves(random_params(agent)))
        for reads in ((), ("body",))
        if (agent := AGENTS[name](hidden_sizes=(8,), spec=PARTED, critic_reads=reads))
    }
    critics = 2 if issubclass(AGENTS[name], SAC) else 1
    assert sizes[0] - sizes[1] == critics * 2 * 8


def test_a_part_that_the_task_does_not_show_is_refused(name):
    with pytest.raises(UsageError, match=r"observation 'gaol'; did you mean 'goal'\? Valid: body"):
        AGENTS[name](critic_reads=["body", "gaol"]).bind(PARTED)
    with pytest.raises(UsageError, match="action_reads = body must be a list of names"):
        AGENTS[name](action_reads="body")


def test_the_learning_rate_follows_its_schedule(name):
    agent = AGENTS[name](learning_rate=2.0, learning_rate_schedule="linear")
    assert agent.scheduled(jnp.array(0.25)).learning_rate == pytest.approx(1.5)
    constant = AGENTS[name](learning_rate=2.0)
    assert constant.scheduled(jnp.array(0.25)).learning_rate == 2.0


def test_rollouts_that_do_not_divide_are_refused(agent):
    if not hasattr(agent, "minibatch_size") or isinstance(agent, PPOGRU):
        agent.check_batch(101)
        return
    sentence = "2 \\* 50 = 100 is not divisible by minibatch_size = 64; the nearest .* is 50"
    with pytest.raises(UsageError, match=sentence):
        agent.check_batch(100, "2 * 50")
