"""What a run's settings stand for: its seeds' keys, and the state in which it goes on."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax import plugins
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.loop import prepare
from hitmdp_jax.runs.run import Run
from tests.probes import Target

REMEMBERING = str(Path(__file__).parents[1] / "probes.py") + ":Remembering"
PPO = {"name": "ppo", "num_epochs": 1, "minibatch_size": 8, "hidden_sizes": (8,)}
SIZES = {"num_envs": 4, "rollout_length": 2, "total_steps": 8}


class Clocked(Target):
    """`Target` whose state also holds a clock."""

    def reset(self, rng):
        return super().reset(rng).replace(info={"clock": jax.numpy.zeros(())})


class Heavy(Target):
    """`Target` with a state of 400 kB, as that of a large body."""

    traced = 0

    def reset(self, rng):
        Heavy.traced += 1
        return super().reset(rng).replace(info={"field": jax.random.normal(rng, (100_000,))})


@pytest.fixture(scope="module", autouse=True)
def tasks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hitmdp_jax.envs.registry._registered", {})
        hitmdp_jax.register_env("target", Target)
        hitmdp_jax.register_env("clocked", Clocked)
        hitmdp_jax.register_env("heavy", Heavy)
        yield


def create(**settings):
    tasks = {"env": {"name": "target"}, "second_env": {"name": "clocked"}}
    return Run.create(RunConfig(**({"algo": PPO} | tasks | SIZES | settings)))


@pytest.fixture(scope="module")
def run(tasks):
    """A transfer of two seeds, 3 and 4."""
    return create(seed=3, seeds=2)


@pytest.fixture(scope="module")
def inits(run):
    return [run.programs(task)[0] for task in range(2)]


@pytest.fixture(scope="module")
def first(run, inits):
    """The state in which the run starts."""
    return run.begin(0, Progress(0, 0, None), inits[0])


@pytest.mark.parametrize(("env", "num_envs", "length"), [("target", 64, 512), ("heavy", 8, 2)])
def test_a_run_is_refused_where_what_it_surely_needs_does_not_fit(
    env, num_envs, length, monkeypatch
):
    """Of what the compiler allots, all that is counted must be there, and not much is left out."""

    def has(size):
        monkeypatch.setattr("hitmdp_jax.runs.devices.memory", lambda: size)

    sizes = {"num_envs": num_envs, "rollout_length": length, "total_steps": 1, "seeds": 2}
    settings = {"env": {"name": env}, "second_env": None} | sizes
    run = create(**settings)
    init, step = run.programs(0)
    state = run.begin(0, Progress(0, 0, None), init)
    allotted = step.lower(state).compile().memory_analysis()
    needed = allotted.argument_size_in_bytes + allotted.temp_size_in_bytes
    has(needed)
    create(**settings)
    has(needed // 10)
    with pytest.raises(UsageError, match="most of it for seeds, num_envs and rollout_length"):
        create(**settings)


def test_a_replay_that_does_not_fit_is_refused():
    plugins.trust(REMEMBERING)
    small = PPO | {"name": REMEMBERING}
    assert create(algo=small | {"capacity": 64}).agent.capacity == 64
    with pytest.raises(UsageError, match="most of it for seeds and algo's replay"):
        create(algo=small | {"capacity": 2_000_000_000}, seeds=1000)


@pytest.mark.whole
def test_a_replay_is_written_in_place_and_kept_on_request(tmp_path):
    """Of a checkpoint without it a run goes on with an empty one."""
    plugins.trust(REMEMBERING)
    algo = PPO | {"name": REMEMBERING, "capacity": 4096}
    for kept in (False, True):
        run = create(algo=algo, second_env=None, save_replay=kept)
        progress = Progress(0, 0, None)
        step = prepare(run, 0, progress)
        given = progress.state.replay.data[1]
        before = given.unsafe_buffer_pointer()
        state, _ = step(progress.state)
        assert given.is_deleted()
        assert state.replay.data[1].unsafe_buffer_pointer() == before
        (tmp_path / str(kept)).mkdir()
        saved = run.saved(Progress(1, 0, state))
        checkpoints = Checkpoints(tmp_path / str(kept))
        checkpoints.save(saved)
        checkpoints.close()
        assert checkpoints.failure is None
        restored = run.restore(Checkpoints(tmp_path / str(kept), read_only=True))
        prepare(run, 0, restored)
        sizes = [int(x) for x in restored.state.replay.size]
        steps = run.schedule.steps_per_report
        assert sizes == [steps if kept else 0]


SAC = {"name": "hit_sac", "hidden_sizes": (4,), "batch_size": 4, "num_options": 2}
SAC |= {"replay_size": 8192, "warmup_steps": 4096}  # two reports


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.whole
def test_an_off_policy_run_goes_on_exactly_or_fills_its_replay_before_it_learns(kept, tmp_path):
    run = create(algo=SAC, second_env=None, save_replay=kept)
    progress = Progress(0, 0, None)
    step = prepare(run, 0, progress)
    for _ in range(2):
        progress.state, _ = step(progress.state)
    checkpoints = Checkpoints(tmp_path)
    checkpoints.save(run.saved(dataclasses.replace(progress, iteration=2)))
    checkpoints.close()
    restored = run.restore(Checkpoints(tmp_path, read_only=True))
    after = prepare(run, 0, restored)
    before = raw(restored.state.learner)
    (unbroken, _), (resumed, _) = step(progress.state), after(restored.state)
    if kept:
        assert run.refills() == ""
        jax.tree.map(np.testing.assert_array_equal, raw(unbroken), raw(resumed))
        return
    assert "fills anew before learning goes on" in run.refills()
    jax.tree.map(np.testing.assert_array_equal, before, raw(resumed.learner))
    again, _ = after(resumed)
    moved = jax.tree.map(lambda x, y: (x != y).any(), before.params, raw(again.learner).params)
    assert any(jax.tree.leaves(moved["actor"]))
    assert (np.asarray(again.learner.params["uniform"]) == 0).all()  # it knows how to act


def test_a_run_without_a_replay_refills_none(run):
    assert run.refills() == ""


def test_a_task_of_ones_own_is_traced_by_its_check_once():
    """And not anew by whatever asks the run for its program."""
    run = create(env={"name": "heavy"}, second_env=None)
    before = Heavy.traced
    run.programs(0)
    assert Heavy.traced == before > 0


def raw(tree):
    def data(x):
        is_key = jax.dtypes.issubdtype(x.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(x) if is_key else x)

    return jax.tree.map(data, tree)


def assert_same(one, other):
    jax.tree.map(np.testing.assert_array_equal, raw(one), raw(other))


def test_a_seed_gets_the_same_key_alone_and_in_company(run):
    keys = [create(seed=seed).keys()[0] for seed in (3, 4)]
    assert_same(jax.numpy.stack(keys), run.keys())
    assert not np.array_equal(*raw(keys))


def test_seeds_lie_on_the_devices_they_share(run, first):
    assert run.mesh.size == 2
    assert first.iteration.sharding.device_set == set(run.mesh.devices.flat)
    assert len(create(seeds=1).mesh.devices) == 1


def test_a_run_starts_from_its_keys_and_goes_on_where_it_was(run, inits, first):
    alone = create(seed=4)
    init, _ = alone.programs(0)
    assert_same(jax.tree.map(lambda x: x[1:], first), alone.begin(0, Progress(0, 0, None), init))
    assert_same(run.begin(0, Progress(7, 0, first), inits[0]), first)


@pytest.mark.parametrize("seeds", [1, 2])
def test_a_restored_state_is_stepped_by_the_same_program(seeds):
    """Or a run that goes on would be compiled once more."""
    run = create(seeds=seeds)
    init, step = run.programs(0)
    first = run.begin(0, Progress(0, 0, None), init)
    restored = jax.device_put(
        jax.tree.map(np.asarray, first.replace(key=jax.random.key_data(first.key))),
        jax.local_devices()[0],
    )
    restored = restored.replace(key=jax.random.wrap_key_data(restored.key))
    again = run.begin(0, Progress(1, 0, restored), init)
    assert step.lower(first).as_text() == step.lower(again).as_text()


def test_a_transfer_keeps_what_was_learned_in_episodes_of_its_own(run, inits, first):
    learned = first.replace(iteration=np.full(2, 5, np.int32))
    state = run.begin(1, Progress(5, 0, learned), inits[1])
    kept = [(s.learner, s.normalizer, s.iteration) for s in (state, learned)]
    assert_same(*kept)
    assert "clock" in state.rollout.env.env.info
    # Neither the seeds nor the two tasks start in the same states.
    starts = raw([x.rollout.env.env.obs for x in (first, state)])
    assert len(np.unique(np.stack(starts))) == 2 * 2 * SIZES["num_envs"]


def test_a_second_task_starts_with_keys_that_no_iteration_uses(run, inits, first):
    starts = []

    def init(keys, hyperparameters):
        starts.append(keys)
        return inits[1](keys, hyperparameters)

    state = run.begin(1, Progress(5, 0, first), init)
    split = jax.vmap(jax.random.split, in_axes=(0, None))
    # What the second task's start and its first iteration (`Program`) make of their keys.
    used = raw([*starts, state.key, split(starts[0], 4), split(state.key, 3)])
    used = np.concatenate([x.reshape(-1, 2) for x in used])
    assert len(np.unique(used, axis=0)) == len(used)


@pytest.mark.parametrize("task", [0, 1])
def test_the_abstract_state_has_the_shapes_of_the_real_one(run, inits, first, task):
    state = run.begin(task, Progress(0, 0, first), inits[task])
    abstract = run.abstract_state(task)
    assert jax.tree.map(lambda x: (x.shape, x.dtype), state) == jax.tree.map(
        lambda x: (x.shape, x.dtype), abstract
    )


def test_a_report_spans_2048_steps(run):
    assert run.schedule.iterations_per_report == 256
    init, step = run.program(0)
    key = jax.random.key(0)
    state, metrics = jax.eval_shape(lambda key: step(init(key)), key)
    assert state.iteration.shape == metrics["episodes"].shape == ()
