import importlib.util
import inspect
from pathlib import Path

import jax
import pytest
import yaml

import hitmdp_jax
from hitmdp_jax.envs import check_env
from hitmdp_jax.errors import UsageError

CONFIGS = Path(__file__).parents[2] / "configs" / "env"


@pytest.mark.parametrize("name", hitmdp_jax.list_envs())
def test_yaml_states_the_constructor_defaults(name):
    settings = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    assert settings.pop("name") == name
    parameters = inspect.signature(check_env(name)).parameters
    if "version" in parameters:
        assert settings.pop("version") == parameters["version"].default
    defaults = {
        p.name: list(p.default) if isinstance(p.default, tuple) else p.default
        for p in parameters.values()
        if p.kind is inspect.Parameter.KEYWORD_ONLY
    }
    assert settings == defaults


def test_every_yaml_names_a_task():
    names = {str(p.relative_to(CONFIGS).with_suffix("")) for p in CONFIGS.rglob("*.yaml")}
    assert {n for n in names if not n.startswith("brax/")} == set(hitmdp_jax.list_envs())
    for name in names:
        settings = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
        assert settings["name"] == name
        check_env(**settings)


@pytest.mark.parametrize("name", hitmdp_jax.list_envs())
def test_states_keep_structure_under_step(name):
    env = hitmdp_jax.make_env(name, physics="native")
    state = jax.eval_shape(env.reset, jax.random.key(0))
    after = jax.eval_shape(env.step, state, jax.ShapeDtypeStruct((env.action_size,), float))
    assert jax.tree.map(lambda x: (x.shape, x.dtype), state) == jax.tree.map(
        lambda x: (x.shape, x.dtype), after
    )
    assert state.obs.shape == (env.observation_size,)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"name": "halfchetah"}, "Unknown environment 'halfchetah'; did you mean 'halfcheetah'?"),
        ({"name": "halfcheetah", "physics": "mjxx"}, "Unknown physics 'mjxx'; did you mean 'mjx'?"),
        ({"name": "halfcheetah", "version": "v6"}, "Unknown version 'v6'"),
        ({"name": "halfcheetah", "ctrl_cost": 1.0}, "did you mean 'ctrl_cost_weight'?"),
        ({"name": "dmc/walker_wolk"}, "did you mean 'dmc/walker_walk'?"),
        ({"name": "dmc/walker_walk", "speed": 1.0}, "Unknown keyword of dmc/walker_walk 'speed'"),
        ({"name": "brax/antt"}, "did you mean 'brax/ant'?"),
        ({"name": "brax/ant", "bakend": "spring"}, "did you mean 'backend'?"),
        ({"name": "brax/ant", "physics": "native"}, "chosen by backend"),
    ],
)
def test_mistakes_are_explained(arguments, sentence):
    with pytest.raises(UsageError) as error:
        hitmdp_jax.make_env(**arguments)
    assert sentence in str(error.value)
    assert str(error.value).count("\n") == 0


def test_missing_dm_control_is_explained_before_anything_is_made(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"needs the extra 'dmc': install it with"):
        check_env("dmc/walker_walk")
