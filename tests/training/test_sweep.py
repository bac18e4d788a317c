import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.agents import PPO
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.numbers import with_numbers
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.envs.suites.base import LibrarySuite
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.evaluation import score_each
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.run import Run
from hitmdp_jax.training.sweep import Training, apart, label, numbers_of, settings_of
from tests.probes import QUICK, untrained_policy

GRID = {"algo.learning_rate": [1e-4, 1e-2], "algo.gamma": [0.9, 0.99, 1.0]}
RANDOM = {"algo.learning_rate": {"log_uniform": [1e-5, 1e-1]}, "algo.gamma": [0.9, 0.99]}


def config(**changes):
    return RunConfig.from_mapping(QUICK | changes)


def first_iteration(config):
    run = Run.create(config)
    init, step = run.programs(0)
    state, metrics = step(run.begin(0, Progress(0, 0, None), init))
    return run.own((state.learner.params, metrics["value_loss"]))


def test_a_grid_is_every_combination_with_every_seed():
    swept = config(sweep=GRID, seeds=2, seed=5)
    assert len(swept.settings) == 6
    assert swept.settings[1] == {"algo.learning_rate": 1e-4, "algo.gamma": 0.99}
    assert swept.trainings[3] == Training(6, 1, swept.settings[1])
    assert swept.trainings[3].name == "seed 6 of learning_rate=0.0001, gamma=0.99"
    np.testing.assert_allclose(swept.swept["gamma"], np.tile(np.repeat([0.9, 0.99, 1.0], 2), 2))


def test_without_a_sweep_there_is_one_setting():
    alone = config(seeds=3)
    assert alone.settings == [{}]
    assert [training.name for training in alone.trainings] == ["seed 0", "seed 1", "seed 2"]
    assert alone.swept == {}


def test_random_settings_come_from_their_ranges_and_from_the_seed_alone():
    draws = settings_of(RANDOM, 400, seed=1)
    assert draws == settings_of(RANDOM, 400, seed=1)
    assert draws != settings_of(RANDOM, 400, seed=2)
    rates = np.log10([draw["algo.learning_rate"] for draw in draws])
    assert rates.min() > -5
    assert rates.max() < -1
    assert abs(rates.mean() + 3) < 0.25  # 4 std of the mean of a uniform one
    assert {draw["algo.gamma"] for draw in draws} == {0.9, 0.99}
    (uniform,) = settings_of({"algo.gamma": {"uniform": [0.5, 0.6]}}, 1, seed=0)
    assert 0.5 <= uniform["algo.gamma"] <= 0.6


@pytest.mark.whole
def test_a_training_of_a_sweep_equals_the_training_alone():
    """Three settings of a seed as one program, and the second of them on its own."""
    swept = config(sweep=RANDOM, samples=3, seed=3)
    together = first_iteration(swept)
    own = {name.removeprefix("algo."): value for name, value in swept.settings[1].items()}
    alone = first_iteration(config(seed=3, algo=QUICK["algo"] | own))
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x[1], y[0], rtol=1e-3, atol=1e-5), together, alone
    )
    kernels = jax.tree.leaves(together[0])[-1]
    assert len(np.unique(np.asarray(kernels).reshape(3, -1), axis=0)) == 3


def test_a_label_names_the_setting():
    assert label({"algo.learning_rate": 3e-4, "algo.gamma": 0.99}) == (
        "learning_rate=0.0003, gamma=0.99"
    )


@pytest.mark.parametrize(
    ("sweep", "samples", "sentence"),
    [
        ({}, None, r"sweep = {} must name what is swept, e\.g\. {algo\.learning_rate"),
        ([1.0], None, r"sweep = \[1\.0\] must name what is swept"),
        ({"algo.gama": [0.9]}, None, r"'algo\.gama'; did you mean 'algo\.gamma'\?"),
        ({"gamma": [0.9]}, None, r"'gamma'; did you mean 'algo\.gamma'\?"),
        ({"algo.num_epochs": [1, 2]}, None, r"algo\.num_epochs shapes the program.*use -m"),
        ({"num_envs": [1, 2]}, None, r"Unknown swept setting 'num_envs'"),
        ({"algo.gamma": 0.9}, None, r"algo\.gamma = 0\.9 must be a list of numbers or a range"),
        ({"algo.gamma": []}, None, r"must be a list of numbers"),
        ({"algo.gamma": [0.9, "a"]}, None, r"must be a list of numbers"),
        ({"algo.gamma": [0.9, True]}, None, r"must be a list of numbers"),
        ({"algo.gamma": [0.9, float("nan")]}, None, r"must be a list of numbers"),
        ({"algo.gamma": [0.9, 0.9]}, None, r"lists a value twice"),
        ({"algo.gamma": [0.9, 1.5]}, None, r"gamma = 1\.5 must be a number from 0 to 1"),
        ({"algo.gamma": {"uniform": [0.5, 0.9]}}, None, r"say how often, samples=20"),
        ({"algo.gamma": {"uniform": [0.9, 0.5]}}, 3, r"must be two ascending numbers\."),
        ({"algo.gamma": {"uniform": [0.9]}}, 3, r"must be two ascending numbers\."),
        ({"algo.gamma": {"log_uniform": [0.0, 0.5]}}, 3, r"two ascending numbers above 0"),
        ({"algo.gamma": {"normal": [0.5, 0.9]}}, 3, r"range of algo\.gamma 'normal'"),
        ({"algo.gamma": {}}, 3, r"Unknown range of algo\.gamma"),
        ({"algo.gamma": [0.9]}, 0, r"samples = 0 must be a positive whole number"),
        ({"algo.gamma": [0.9]}, "a", r"samples = a must be a positive whole number"),
        (None, 3, r"samples = 3 draws from a sweep: give one"),
    ],
)
def test_bad_sweeps_are_explained(sweep, samples, sentence):
    with pytest.raises(UsageError, match=sentence):
        config(sweep=sweep, samples=samples)


CHEETAH = {"env": {"name": "halfcheetah"}, "num_envs": 2, "rollout_length": 1024}
TURKEY = {"env": {"name": "toy/turkey"}, "physics": "mjx"}
ROOMS = {"env": {"name": "gymnax/FourRooms-misc"}, "physics": "mjx"}
PENDULUM = {"env": {"name": "gymnax/Pendulum-v1"}, "physics": "mjx"}


@pytest.mark.parametrize(("task", "sweep", "losses"), [
    (CHEETAH, {"env.ctrl_cost_weight": [0.1, 3.0], "env.forward_reward_weight": [1.0, 2.0]}, 4),
    # The rate changes what is learned of the first rollout, and not its loss.
    (TURKEY, {"env.stuffed_reward": [5.0, 20.0], "algo.learning_rate": [1e-4, 1e-2]}, 2),
    (ROOMS, {"env.fail_prob": [0.1, 0.3, 0.6]}, 3),
    (PENDULUM, {"env.g": [5.0, 10.0], "env.m": [1.0, 2.0]}, 4),
])  # fmt: skip
@pytest.mark.whole
def test_a_task_whose_number_is_swept_trains_as_it_does_alone(task, sweep, losses):
    swept = config(**task, sweep=sweep, seed=3)
    together = first_iteration(swept)
    of_agent, of_task = apart(swept.settings[2])
    own = {"env": task["env"] | of_task, "algo": QUICK["algo"] | of_agent}
    alone = first_iteration(config(**task | own, seed=3))
    compare = functools.partial(np.testing.assert_allclose, rtol=2e-3, atol=1e-5)
    jax.tree.map(lambda a, b: compare(a[2], b[0]), together, alone)
    assert len(np.unique(np.asarray(together[1]).round(5))) == losses


def test_a_policy_is_scored_in_the_task_of_its_own_setting(key):
    """Whoever roasts at once gets what roasting a plain turkey is worth."""
    env = make_env("toy/turkey")
    agent = PPO(hidden_sizes=(8,)).bind(spec_of(env))
    policy = untrained_policy(agent, key)
    several = jax.tree.map(lambda x: jnp.stack([x] * 3), policy)
    numbers = {"plain_reward": np.float32([-10.0, -1.0, 4.0])}
    keys, task = [key] * 3, {"name": "toy/turkey"}
    scores = score_each(several, task, "mjx", 64, keys, numbers=numbers)
    (usual,) = score_each(several.of(np.array([0])), task, "mjx", 64, keys[:1])
    assert set(usual.returns) <= {-10.0, 0.0, 10.0}
    assert (usual.returns == -10.0).any()
    for score, worth in zip(scores, numbers["plain_reward"], strict=True):
        np.testing.assert_allclose(score.returns, np.where(usual.returns < 0, worth, usual.returns))


def test_each_setting_of_a_task_plays_the_episodes_that_it_plays_alone(key):
    """To the bit, in slippery rooms: they differ only in how often a step goes astray."""
    env = make_env("gymnax/FourRooms-misc")
    policy = untrained_policy(PPO(hidden_sizes=(8,)).bind(spec_of(env)), key)
    several = jax.tree.map(lambda x: jnp.stack([x] * 3), policy)
    slips = np.float32([0.0, 0.3, 0.9])
    task, keys = {"name": "gymnax/FourRooms-misc"}, [key] * 3
    scores = score_each(several, task, "mjx", 16, keys, numbers={"fail_prob": slips})
    lengths = [tuple(score.lengths) for score in scores]
    assert len(set(lengths)) == 3
    for slip, together in zip(slips, lengths, strict=True):
        own = task | {"fail_prob": float(slip)}
        (alone,) = score_each(several.of(np.array([0])), own, "mjx", 16, [key])
        assert tuple(alone.lengths) == together


def test_a_number_of_a_library_that_is_not_installed_is_left_to_it(monkeypatch):
    """So that a run can be read where nothing is trained."""
    changes = ROOMS | {"sweep": {"env.fail_prob": [0.1, 0.3]}}
    monkeypatch.setattr(LibrarySuite, "installed", False)
    assert config(**changes).settings == [{"env.fail_prob": 0.1}, {"env.fail_prob": 0.3}]
    with pytest.raises(UsageError, match=r"hitmdp-jax\[gymnax\]"):
        config(**changes).check_installed()


def test_a_setting_of_a_task_has_its_number_wherever_it_is_used():
    swept = config(**TURKEY, sweep={"env.stuffed_reward": [5.0, 20.0]}, seeds=2)
    assert swept.trainings[2].name == "seed 0 of env.stuffed_reward=20"
    assert swept.task_at(1, swept.trainings[2]) == {"name": "toy/turkey", "stuffed_reward": 20.0}
    assert swept.task_at(1) == {"name": "toy/turkey"}
    np.testing.assert_array_equal(numbers_of(swept.trainings)["stuffed_reward"], [5, 5, 20, 20])


def test_a_held_action_is_held_in_the_task_of_other_numbers(key):
    env = with_numbers(make_env("toy/turkey", action_repeat=2), {"stuffed_reward": 3.0})
    state = env.step(env.reset(key), jnp.array([-1.0]))  # stuffs, and must roast it then
    assert state.reward == 0.0
    state = make_env("toy/turkey").step(env.env.reset(key), jnp.array([-1.0]))
    assert env.env.step(state, jnp.array([1.0])).reward == 3.0


@pytest.mark.parametrize(("task", "name", "sentence"), [
    (CHEETAH, "env.reset_noise_scale", "is no number that the task reads at each step, so one "),
    (CHEETAH, "env.ctrl_cost_weigth", "did you mean 'env.ctrl_cost_weight'"),
    (CHEETAH | {"second_env": {"name": "hopper"}}, "env.ctrl_cost_weight", "sweeps algo. alone"),
    ({"env": {"name": "toy/cue"}, "physics": "mjx"}, "env.length", "is no number that the task"),
    (PENDULUM, "env.max_torque", "env.max_torque is no number that the task reads at each step"),
    (PENDULUM, "env.max_steps_in_episode", "is no number that the task reads at each step"),
    (ROOMS, "env.fail_probe", "did you mean 'env.fail_prob'"),
    (ROOMS, "env.resample_goal_pos", "sweep takes .*, env.fail_prob"),
])  # fmt: skip
def test_a_number_that_cannot_be_swept_is_named(task, name, sentence):
    with pytest.raises(UsageError, match=sentence):
        config(**task, sweep={name: [0.5, 1.0]})
