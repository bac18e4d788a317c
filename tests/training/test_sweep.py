import jax
import numpy as np

from hitmdp_jax.training.checkpoint import Progress
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.run import Run
from hitmdp_jax.training.sweep import devices_for

# The runs of tests/commands, which are compiled once for both.
QUICK = {
    "algo": {"name": "ppo", "num_epochs": 1},
    "env": {"name": "invertedpendulum"},
    "physics": "native",
}


def test_seeds_are_shared_out_evenly():
    assert len(jax.local_devices()) == 2
    assert [len(devices_for(n)) for n in (1, 2, 3, 10)] == [1, 2, 1, 2]


def learned(**settings):
    run = Run.create(RunConfig.from_mapping(QUICK | settings))
    init, step = run.programs(0)
    state, metrics = step(run.begin(0, Progress(0, 0, None), init))
    state = state.replace(key=jax.random.key_data(state.key))
    return jax.device_get((state, metrics))


def test_a_seed_among_others_on_two_devices_equals_the_seed_alone():
    together = learned(seeds=4)
    for place, seed in ((0, 0), (3, 3)):
        alone = learned(seeds=1, seed=seed)
        here = jax.tree.map(lambda x, place=place: x[place : place + 1], together)
        jax.tree.map(
            lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4), here, alone
        )
