import dataclasses
from pathlib import Path

import hydra
import pytest
import yaml
from omegaconf import OmegaConf

from hitmdp_jax.agents import AGENTS
from hitmdp_jax.envs import list_envs
from hitmdp_jax.errors import UsageError
from hitmdp_jax.training.config import RunConfig

CONFIGS = Path(__file__).parents[2] / "configs"
SETTINGS = {
    "env": {"name": "halfcheetah"},
    "algo": {"name": "mopg"},
    "physics": "native",
    "seeds": 1,
    "seed": 0,
    "total_steps": 1e6,
    "num_envs": 16,
    "rollout_length": 128,
    "checkpoint_steps": 1000,
}


@pytest.mark.parametrize("name", sorted(AGENTS))
def test_yaml_states_every_hyperparameter_and_its_default(name):
    settings = yaml.safe_load((CONFIGS / "algo" / f"{name}.yaml").read_text())
    settings = settings.get("algo", settings)
    assert settings.pop("name") == name
    defaults = {
        f.name: list(f.default) if isinstance(f.default, tuple) else f.default
        for f in dataclasses.fields(AGENTS[name])
    }
    assert settings == defaults


def test_every_setting_of_the_yaml_is_known():
    settings = yaml.safe_load((CONFIGS / "config.yaml").read_text())
    names = {f.name for f in dataclasses.fields(RunConfig)}
    from_groups = {"env", "algo", "second_env"}
    assert set(settings) - {"defaults", "hydra", "resume", "run_dir"} | from_groups == names


def test_every_pair_names_two_tasks():
    pairs = {p.stem: p for p in (CONFIGS / "pair").glob("*.yaml") if p.stem != "none"}
    assert set(pairs) == {"cartpole", "reacher", "cheetah", "fish", "walker1", "walker2"}
    for path in pairs.values():
        settings = yaml.safe_load(path.read_text())
        assert settings["defaults"][0]["override /env"] in list_envs()
        assert settings["second_env"]["name"] in list_envs()


@pytest.mark.parametrize("algo", sorted(AGENTS))
def test_a_transfer_has_relu_bodies_and_switches_after_total_steps(algo):
    with hydra.initialize_config_dir(str(CONFIGS), version_base="1.3"):
        overrides = [f"algo={algo}", "experiment=transfer", "pair=fish", "total_steps=10_000"]
        settings = OmegaConf.to_container(hydra.compose("config", overrides=overrides))
    config = RunConfig.from_mapping(
        {k: v for k, v in settings.items() if k not in ("resume", "run_dir")}
    )
    assert config.make_agent().activation == "relu"
    assert config.task_title == "dmc/fish_upright, then dmc/fish_downleft"
    assert 10_000 <= config.switch_at < 10_000 + 2048
    assert RunConfig.from_mapping(SETTINGS).switch_at is None


def test_settings_survive_saving(tmp_path):
    config = RunConfig.from_mapping(SETTINGS)
    config.save(tmp_path / "config.yaml")
    assert RunConfig.load(tmp_path) == config
    assert config.total_steps == 1_000_000
    assert config.iterations == 489


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"seeds": 0}, "seeds = 0 must be a positive whole number"),
        ({"seeds": "many"}, "seeds = many must be a positive whole number"),
        ({"total_steps": 1.5}, "total_steps = 1.5 must be a positive whole number"),
        ({"seed": -1}, "seed = -1 must be a whole number from 0"),
        ({"physics": "natve"}, "Unknown physics 'natve'; did you mean 'native'?"),
        ({"algo": {"name": "mop"}}, "Unknown algo 'mop'; did you mean 'mopg'?"),
        ({"algo": {"name": "ppo", "gama": 1}}, "Unknown hyperparameter of ppo 'gama'"),
        ({"algo": {"name": "ppo", "gamma": "x"}}, "algo.gamma = x must be a number"),
        ({"algo": {"name": "ppo", "learning_rate": -1}}, "learning_rate = -1.0 must be"),
        ({"env": {"name": "cheetah"}}, "did you mean 'halfcheetah'?"),
        ({"rollout_length": 10}, "is not divisible by minibatch_size = 64"),
        ({"steps": 3}, "Unknown setting 'steps'"),
    ],
)
def test_mistakes_are_explained(change, sentence):
    with pytest.raises(UsageError) as error:
        RunConfig.from_mapping(SETTINGS | change)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_a_folder_without_a_run_is_explained(tmp_path):
    with pytest.raises(UsageError, match="is not a run's folder"):
        RunConfig.load(tmp_path)
