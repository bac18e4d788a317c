"""The suites of other libraries against the libraries themselves, along random trajectories."""

import importlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax import UsageError, make_env
from hitmdp_jax.envs.contract import check_task
from hitmdp_jax.envs.keywords import parameters_of
from hitmdp_jax.envs.numbers import traced_of, with_numbers
from hitmdp_jax.envs.spec import Box, Discrete
from hitmdp_jax.envs.suites import find_suite
from tests.programs import compiled

STEPS = 40
HEAVY = pytest.mark.slow  # a minute and more to compile


def listed_by_gymnax():
    known = set(importlib.import_module("gymnax").registered_envs)
    return known - {"MNISTBandit-bsuite"}  # which fetches its pictures from the network


def listed_by_xminigrid():
    known = importlib.import_module("xminigrid").registered_environments()
    return {name for name in known if name.startswith("MiniGrid-")}


def listed_by_playground():
    return set(importlib.import_module("mujoco_playground").registry.ALL_ENVS)


@pytest.mark.parametrize("suite", ["gymnax", "xminigrid", "playground"])
def test_the_names_are_those_of_the_library(suite):
    names = {name.removeprefix(f"{suite}/") for name in find_suite(f"{suite}/").names()}
    assert names == globals()[f"listed_by_{suite}"]()


def walk(env, key):
    """Return the states [STEPS + 1] along random actions, and the actions."""

    def choose(key):
        action = env.spec.action
        if isinstance(action, Discrete):
            return jax.random.randint(key, (), 0, action.n)
        low, high = (jnp.asarray(x, jnp.float32) for x in (action.low, action.high))
        return jax.random.uniform(key, action.shape, minval=low, maxval=high)

    @compiled
    def run(key):
        first = env.reset(key)
        actions = jax.vmap(choose)(jax.random.split(key, STEPS))

        def step(state, action):
            state = env.step(state, action)
            return state, state

        return first, actions, jax.lax.scan(step, first, actions)[1]

    return run(key)


GYMNAX = {
    "CartPole-v1": {},
    "Pendulum-v1": {"max_steps_in_episode": 30},
    "FourRooms-misc": {"fail_prob": 0.2, "resample_goal_pos": True},
    "FrozenLake-misc": {},
    "Breakout-MinAtar": {},
}


@pytest.mark.parametrize("name", GYMNAX)
def test_gymnax_steps_as_it_does_by_itself(name, key):
    """Up to the first end, after which the library would start anew and we would not."""
    keywords = GYMNAX[name]
    env = make_env(f"gymnax/{name}", **keywords)
    first, actions, states = walk(env, key)
    task, params = importlib.import_module("gymnax").make(name)
    params = params.replace(**keywords)
    key, key_start = jax.random.split(key)
    obs, own = task.reset_env(key_start, params)
    step = jax.jit(task.step_env)
    assert_shown(env, first.obs, obs)
    for t in range(STEPS):
        key, key_step = jax.random.split(key)
        obs, own, reward, terminated, _ = step(key_step, own, actions[t], params)
        ended = bool(terminated), bool(task.is_truncated(own, params))
        assert_shown(env, states.obs[t], obs)
        np.testing.assert_allclose(states.reward[t], reward, rtol=1e-6)
        assert bool(states.done[t]) == any(ended)
        assert bool(states.info["truncation"][t]) == (ended == (False, True))
        if any(ended):
            break
    assert name != "Pendulum-v1" or t == 29


def assert_shown(env, mine, theirs):
    """One of n symbols is shown as a row of n numbers."""
    if np.ndim(theirs) == 0:
        theirs = np.eye(env.spec.observation.size)[int(theirs)]
    np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["Asterix-MinAtar", "Seaquest-MinAtar", "Pong-misc"])
@pytest.mark.whole
def test_planes_of_squares_are_whole_in_booleans(name, key):
    """Of the tasks whose library adds up numbers: the others' are booleans there, too."""
    env = make_env(f"gymnax/{name}")
    task, params = importlib.import_module("gymnax").make(name)

    @compiled
    def run(key):
        def step(state, key):
            keys = jax.random.split(key)
            action = jax.random.randint(keys[0], (), 0, env.spec.action.n)
            obs, state, *_ = task.step(keys[1], state, action, params)  # which starts anew
            return state, obs

        return jax.lax.scan(step, task.reset(key, params)[1], jax.random.split(key, 500))[1]

    theirs = np.asarray(run(key))
    mine = np.asarray(env.observation(theirs))
    assert mine.dtype == bool
    assert theirs.any()
    np.testing.assert_array_equal(mine, theirs)


@pytest.mark.whole
def test_minigrid_steps_as_it_does_by_itself(key):
    name, view = "MiniGrid-DoorKey-5x5", 5
    env = make_env(f"xminigrid/{name}", view_size=view, max_steps=STEPS - 10)
    first, actions, states = walk(env, key)
    task, params = importlib.import_module("xminigrid").make(name)
    params = params.replace(view_size=view, max_steps=STEPS - 10)
    now, step = task.reset(params, key), jax.jit(task.step)
    for t in range(-1, STEPS):
        seen = first if t < 0 else jax.tree.map(lambda x, t=t: x[t], states)
        tiles = seen.obs.reshape(view, view, 25)
        assert tiles.dtype == bool
        np.testing.assert_array_equal(tiles[..., :13].argmax(-1), now.observation[..., 0])
        np.testing.assert_array_equal(tiles[..., 13:].argmax(-1), now.observation[..., 1])
        assert float(tiles.sum()) == 2 * view**2
        assert float(seen.reward) == float(now.reward)
        assert bool(seen.done) == bool(now.last())
        if now.last():
            break
        now = step(params, now, actions[t + 1])
    assert t == STEPS - 11
    assert float(seen.info["truncation"]) == 1.0 - float(seen.metrics["success"])


@HEAVY
@pytest.mark.parametrize("name", ["Craftax-Classic-Symbolic-v1", "Craftax-Symbolic-v1"])
def test_craftax_steps_as_it_does_by_itself(name, key):
    env = make_env(f"craftax/{name}")
    assert env.shortest_episode == 32
    first, actions, states = walk(env, key)
    task = importlib.import_module("craftax.craftax_env").make_craftax_env_from_name(name, False)
    key, key_start = jax.random.split(key)
    obs, own = jax.jit(task.reset_env)(key_start, task.default_params)
    np.testing.assert_allclose(first.obs, obs, atol=1e-6)
    step, achieved = jax.jit(task.step_env), np.zeros(len(states.metrics))
    for t in range(STEPS):
        key, key_step = jax.random.split(key)
        obs, own, reward, done, _ = step(key_step, own, actions[t], task.default_params)
        np.testing.assert_allclose(states.obs[t], obs, atol=1e-6)
        np.testing.assert_allclose(states.reward[t], reward, atol=1e-6)
        assert bool(states.done[t]) == bool(done)
        achieved += [float(x[t]) for x in states.metrics.values()]
        if done:
            break
    assert achieved.sum() == own.achievements.sum()


@HEAVY
@pytest.mark.parametrize("name", ["CheetahRun", "CartpoleBalance"])
def test_playground_steps_as_it_does_by_itself(name, key):
    env = make_env(f"playground/{name}")
    assert env.shortest_episode == env.spec.episode_length
    first, actions, states = walk(env, key)
    registry = importlib.import_module("mujoco_playground").registry
    task = registry.load(name, config_overrides={"impl": "jax"})
    state, step = jax.jit(task.reset)(key), jax.jit(task.step)
    np.testing.assert_allclose(first.obs, state.obs, atol=1e-5)
    for t in range(STEPS):
        state = step(state, actions[t])
        np.testing.assert_allclose(states.obs[t], state.obs, rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(states.reward[t], state.reward, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("gymnax/FourRoms-misc", "did you mean 'gymnax/FourRooms-misc'"),
        ("xminigrid/MiniGrid-DorKey-8x8", "did you mean 'xminigrid/MiniGrid-DoorKey-8x8'"),
        ("craftax/Craftax-Symbolic-v2", "did you mean 'craftax/Craftax-Symbolic-v1'"),
        ("playground/CheetahRuns", "did you mean 'playground/CheetahRun'"),
    ],
)
def test_a_mistaken_name_gets_the_nearest_of_its_suite(name, sentence):
    with pytest.raises(UsageError, match=sentence):
        make_env(name)


@pytest.mark.parametrize("suite", ["gymnax", "xminigrid", "craftax", "playground"])
def test_a_missing_library_is_told_with_the_line_that_installs_it(suite, monkeypatch):
    known = find_suite(f"{suite}/")
    monkeypatch.setattr(type(known), "installed", False)
    with pytest.raises(UsageError, match=rf"pip install 'hitmdp-jax\[{suite}\]'"):
        make_env(known.names()[0])


def test_keywords_of_a_library_are_checked():
    with pytest.raises(UsageError, match="did you mean 'fail_prob'"):
        make_env("gymnax/FourRooms-misc", fail_prb=0.1)


def test_a_number_of_a_task_steps_as_a_task_made_with_it_does(key):
    """Of gymnax and of Craftax, whose numbers the library reads from its parameters."""
    env = make_env("gymnax/CartPole-v1")
    assert {"gravity", "length", "x_threshold"} < set(env.traced)
    changed = {"gravity": 20.0, "force_mag": 3.0}
    states = [
        walk(one, key)[2]
        for one in (env, with_numbers(env, changed), make_env("gymnax/CartPole-v1", **changed))
    ]
    usual, traced, made = (np.asarray(x.obs) for x in states)
    np.testing.assert_allclose(traced, made, rtol=1e-6)
    assert np.abs(usual - made).max() > 0.1
    assert env.params.gravity == 9.8  # the given one stays as it is
    craftax = find_suite("craftax/").constructor("craftax/Craftax-Classic-Symbolic-v1")
    assert "spawn_cow_chance" in traced_of(craftax)


@pytest.mark.parametrize(("name", "left_out"), [
    ("gymnax/Pendulum-v1", {"max_torque"}),
    ("gymnax/MountainCarContinuous-v0", {"min_action", "max_action"}),
    ("gymnax/BernoulliBandit-misc", {"max_steps_in_episode"}),
])  # fmt: skip
def test_what_the_spec_is_made_of_is_no_number_of_the_program(name, left_out):
    """The limits of an action, and the time limit."""
    made = find_suite(name).constructor(name)
    floats = {key for key, x in parameters_of(made).items() if type(x.default) is float}
    assert floats - set(traced_of(made)) == left_out


def test_the_tasks_keep_the_contract():
    for name in ("gymnax/MountainCarContinuous-v0", "xminigrid/MiniGrid-Empty-5x5"):
        env = make_env(name)
        assert isinstance(env.spec.action, Box | Discrete)
        check_task(env, name)
