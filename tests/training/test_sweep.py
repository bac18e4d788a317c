import jax
import numpy as np
import pytest

from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.run import Run
from hitmdp_jax.training.sweep import Training, label, settings_of
from tests.probes import QUICK

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
        ({"num_envs": [1, 2]}, None, r"Unknown swept hyperparameter 'num_envs'"),
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
