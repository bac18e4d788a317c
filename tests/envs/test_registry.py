import importlib.util

import jax
import jax.numpy as jnp
import pytest
from brax.envs.base import Env, State
from brax.envs.wrappers import training

import hitmdp_jax
from hitmdp_jax import physics
from hitmdp_jax.envs import check_env, check_installed
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.errors import UsageError

ON_WARP = ("halfcheetah", "dmc/reacher_easy", "maze/ant_umaze")  # stand for all: tracing takes 2 s


@pytest.mark.parametrize(
    ("name", "engine"),
    [
        *((name, "native") for name in hitmdp_jax.list_envs()),
        *(
            pytest.param(name, "warp", marks=() if name in ON_WARP else pytest.mark.slow)
            for name in hitmdp_jax.list_envs()
        ),
    ],
)
def test_states_keep_structure_under_step(name, engine):
    env = hitmdp_jax.make_env(name, physics=engine)
    state = jax.eval_shape(env.reset, jax.random.key(0))
    action = spec_of(env).action
    after = jax.eval_shape(env.step, state, jax.ShapeDtypeStruct(action.shape, action.dtype))
    assert jax.tree.map(lambda x: (x.shape, x.dtype), state) == jax.tree.map(
        lambda x: (x.shape, x.dtype), after
    )
    assert state.obs.shape == (env.observation_size,)


@pytest.mark.parametrize("name", hitmdp_jax.list_envs())
def test_braxs_own_trainers_can_wrap_every_task(name):
    """Their wrappers keep fields of their own in `info` and `metrics`, through every step."""
    task = hitmdp_jax.make_env(name, physics="native")
    env = training.EvalWrapper(training.wrap(task, episode_length=8))
    action = spec_of(task).action
    keys = jax.random.split(jax.random.PRNGKey(0), 2)  # keys of the old kind, as theirs are
    state = jax.eval_shape(env.reset, keys)
    actions = jax.ShapeDtypeStruct((2, *action.shape), action.dtype)
    after = jax.eval_shape(env.step, state, actions)
    assert jax.tree.structure(state) == jax.tree.structure(after)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"name": "halfchetah"}, "Unknown environment 'halfchetah'; did you mean 'halfcheetah'?"),
        ({"name": "halfcheetah", "physics": "mjxx"}, "Unknown physics 'mjxx'; did you mean 'mjx'?"),
        ({"name": "halfcheetah", "version": "v6"}, "Unknown version 'v6'"),
        ({"name": "halfcheetah", "version": 5}, "Unknown version '5'"),
        ({"name": "toy/turkey", "physics": "natve"}, "did you mean 'native'?"),
        ({"name": "ant", "main_body": "torsoo"}, "Unknown main_body 'torsoo'; did you mean"),
        ({"name": None}, "env = None must be the name of an environment"),
        ({"name": 3}, "env = 3 must be the name of an environment"),
        ({"name": "no/such/file.py:Task"}, "there is no 'no/such/file.py' here"),
        ({"name": "halfcheetah", "ctrl_cost": 1.0}, "did you mean 'ctrl_cost_weight'?"),
        ({"name": "dmc/walker_wolk"}, "did you mean 'dmc/walker_walk'?"),
        ({"name": "dmc/walker_walk", "speed": 1.0}, "Unknown keyword of dmc/walker_walk 'speed'"),
        ({"name": "brax/antt"}, "did you mean 'brax/ant'?"),
        ({"name": "brax/ant", "bakend": "spring"}, "did you mean 'backend'?"),
        ({"name": "brax/ant", "backend": "sprin"}, "did you mean 'spring'?"),
        ({"name": "brax/ant", "physics": "native"}, "physics must stay at its default"),
    ],
)
def test_mistakes_are_explained(arguments, sentence):
    with pytest.raises(UsageError) as error:
        hitmdp_jax.make_env(**arguments)
    assert sentence in str(error.value)
    assert str(error.value).count("\n") == 0


def test_missing_dm_control_is_explained_before_anything_is_made(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert check_env("dmc/walker_walk").__name__ == "WalkerWalk"  # settings can still be read
    for attempt in (hitmdp_jax.make_env, check_installed):
        with pytest.raises(UsageError, match=r"needs the extra 'dmc': install it with"):
            attempt("dmc/walker_walk")
    check_installed("hopper")


class Corridor(Env):
    """A plain Brax environment: walk right to the end of a corridor, without MuJoCo."""

    observation_size = action_size = 1
    backend = "none"

    def __init__(self, length: int = 3, version: str = "v1"):
        self.length, self.version = length, version

    def reset(self, rng):
        return State(None, jnp.zeros(1), jnp.zeros(()), jnp.zeros(()))

    def step(self, state, action):
        place = state.obs + jnp.sign(action)
        return state.replace(obs=place, done=(place[0] >= self.length).astype(float))


@pytest.fixture
def registry(monkeypatch):
    monkeypatch.setattr("hitmdp_jax.envs.registry._registered", {})


@pytest.mark.usefixtures("registry")
def test_a_registered_environment_is_made_by_its_name():
    hitmdp_jax.register_env("mine/corridor", Corridor)
    assert hitmdp_jax.list_envs()[-1] == "mine/corridor"
    env = hitmdp_jax.make_env("mine/corridor", version="v2", length=1)
    assert (env.length, env.version) == (1, "v2")
    assert env.step(env.reset(None), jnp.ones(1)).done
    with pytest.raises(UsageError, match=r"length = 1.5 must be a whole number"):
        check_env("mine/corridor", length=1.5)
    with pytest.raises(UsageError, match=r"did you mean 'mine/corridor'\?"):
        check_env("mine/coridor")
    hitmdp_jax.register_env("mine/corridor", lambda: Corridor(7))
    assert hitmdp_jax.make_env("mine/corridor").length == 7


@pytest.mark.usefixtures("registry")
def test_a_constructor_gets_the_engine_if_it_takes_one():
    seen = []
    hitmdp_jax.register_env("mine", lambda physics: seen.append(physics) or Corridor())
    hitmdp_jax.make_env("mine", physics="native")
    assert seen == [physics.ENGINES["native"]]


@pytest.mark.usefixtures("registry")
@pytest.mark.parametrize(
    ("name", "constructor", "sentence"),
    [
        ("hopper", Corridor, "'hopper' is a built-in environment"),
        ("brax/ant", Corridor, "'brax/ant' is a built-in environment"),
        ("", Corridor, "name = '' must be"),
        (3, Corridor, "name = 3 must be"),
        ("file.py:Task", Corridor, "must be a string that is not empty and names no file"),
        ("mine", 3, "constructor = 3 must be a class or function"),
    ],
)
def test_names_and_constructors_that_cannot_be_registered(name, constructor, sentence):
    with pytest.raises(UsageError) as error:
        hitmdp_jax.register_env(name, constructor)
    assert sentence in str(error.value)


@pytest.mark.usefixtures("registry")
def test_what_makes_no_environment_is_refused():
    hitmdp_jax.register_env("mine", lambda: {})
    with pytest.raises(UsageError, match=r"'mine' makes no environment"):
        hitmdp_jax.make_env("mine")


def test_errors_of_a_users_own_file_keep_their_traceback(tmp_path):
    file = tmp_path / "broken_task.py"
    file.write_text(
        "class Late:\n    reset = step = None\n    def __init__(self):\n        {}['goal']\n"
    )
    with pytest.raises(KeyError, match=r"goal") as error:
        hitmdp_jax.make_env(f"{file}:Late")
    assert str(error.traceback[-1].path) == str(file)
    with pytest.raises(UsageError, match=r"Unknown class of .*'Lat'; did you mean 'Late'\?"):
        check_env(f"{file}:Lat")
