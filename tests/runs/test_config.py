import dataclasses
from pathlib import Path

import pytest
import yaml

from hitmdp_jax.agents import AGENTS
from hitmdp_jax.agents.base import hyperparameters_of
from hitmdp_jax.cli.run_settings import HOST_SETTINGS
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs import suite_names
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.config import RunConfig

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
        for f in hyperparameters_of(AGENTS[name])
    }
    assert settings == defaults


def test_every_setting_of_the_yaml_is_known():
    settings = yaml.safe_load((CONFIGS / "config.yaml").read_text())
    names = {f.name for f in dataclasses.fields(RunConfig)}
    from_groups = {"env", "algo", "second_env"}
    host = {"defaults", "hydra", *HOST_SETTINGS}
    assert set(settings) - host | from_groups == names
    for field in dataclasses.fields(RunConfig):
        if field.name not in from_groups:
            assert settings[field.name] == field.default, field.name


def test_every_pair_names_two_tasks():
    pairs = {p.stem: p for p in (CONFIGS / "pair").glob("*.yaml") if p.stem != "none"}
    of_dmc = {"cartpole", "reacher", "cheetah", "fish", "walker1", "walker2"}
    assert set(pairs) == {*of_dmc, "fourrooms"}
    for path in pairs.values():
        settings = yaml.safe_load(path.read_text())
        assert settings["defaults"][0]["override /env"] in suite_names()
        assert settings["second_env"]["name"] in suite_names()


@pytest.mark.parametrize("algo", sorted(AGENTS))
def test_a_transfer_has_relu_bodies_and_switches_after_total_steps(algo):
    overrides = [f"algo={algo}", "experiment=transfer", "pair=fish", "total_steps=10_000"]
    config = Settings(overrides).config()
    assert config.make_agent().activation == "relu"
    assert config.task_title == "dmc/fish_upright, then dmc/fish_downleft"
    assert 10_000 <= config.switch_at < 10_000 + 2048
    assert RunConfig.from_mapping(SETTINGS).switch_at is None


def test_every_iteration_of_a_transfer_has_its_task():
    config = Settings(["experiment=transfer", "pair=fish", "total_steps=10_000"]).config()
    names = [config.task_at(i)["name"] for i in range(1, config.schedule.last_iteration + 1)]
    assert names == ["dmc/fish_upright"] * 5 + ["dmc/fish_downleft"] * 5
    assert config.task_at(0) == config.env


def test_those_who_need_it_keep_trying_in_a_transfer():
    """MOPG and PPO have the entropy weight that the paper prints; the others have their own."""

    def weight(*overrides):
        return Settings(overrides).config().algo.get("entropy_weight")

    for algo in ("mopg", "ppo"):
        assert weight(f"algo={algo}") == 0.0
        assert weight(f"algo={algo}", "experiment=transfer") == 0.01
        assert weight(f"algo={algo}", "experiment=transfer", "algo.entropy_weight=0.1") == 0.1
    assert weight("algo=ahp", "experiment=transfer") is None


def test_settings_survive_saving(tmp_path):
    config = RunConfig.from_mapping(SETTINGS)
    (tmp_path / "config.yaml").write_text(config.to_yaml())
    assert RunConfig.load(tmp_path) == config
    assert config.total_steps == 1_000_000
    assert config.schedule.iterations == 489


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
        ({"total_steps": 1e20}, "total_steps = 1e+20 must be a positive whole number, at most"),
        ({"total_steps": float("nan")}, "total_steps = nan must be a positive whole number"),
        ({"total_steps": float("inf")}, "total_steps = inf must be a positive whole number"),
        ({"seed": 12345678901234567890}, "seed = 12345678901234567890 must be a whole number"),
        ({"seed": 2**32 - 1, "seeds": 2}, "must be a whole number below 2^32 - seeds"),
        ({"wandb": "on"}, "Unknown wandb 'on'"),
        ({"env": "halfcheetah"}, "env = halfcheetah must hold a name"),
        ({"algo": {}}, "algo = {} must hold a name"),
        ({"algo": {"name": "ppo", "learning_rate": float("inf")}}, "learning_rate = inf must be"),
        ({"algo": {"name": "ppo", "gamma": float("nan")}}, "gamma = nan must be"),
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


def test_a_run_of_an_older_version_takes_the_defaults(tmp_path):
    (tmp_path / "config.yaml").write_text("algo: {name: ppo}\nenv: {name: halfcheetah}\n")
    config = RunConfig.load(tmp_path)
    assert config.eval_every == 0
    assert config.num_envs == 16


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("schema: 99\nalgo: {name: ppo}\n", "written by a newer hitmdp_jax (schema 99"),
        ("schema: 2\nalgo: {name: ppo}\n", "written by an older hitmdp_jax (schema 2), which"),
        ("schema: x\nalgo: {name: ppo}\n", "written by a newer hitmdp_jax"),
        ("", "does not hold a run's settings"),
        ("- a\n- list\n", "does not hold a run's settings"),
        ("algo: {name: ppo\n", "cannot be read: line 2"),
        ("env: {name: halfcheetah}\n", "algo = None must hold a name"),
        ("algo: {name: ppo}\nfuture_setting: 1\n", "Unknown setting 'future_setting'"),
        ("algo: !!python/object/apply:os.getcwd []\n", "cannot be read: line 1: the tag"),
    ],
)
def test_settings_that_cannot_be_read_are_explained(tmp_path, text, sentence):
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(UsageError) as error:
        RunConfig.load(tmp_path)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_differences_are_named_and_those_beside_the_point_are_not():
    one = RunConfig.from_mapping(SETTINGS)
    other = RunConfig.from_mapping(SETTINGS | {"seeds": 3, "checkpoint_steps": 7, "eval_every": 5})
    assert one.differences(other) == ["seeds: 1 here, 3 there"]
    assert one.differences(RunConfig.from_mapping(one.to_dict())) == []


@pytest.mark.parametrize("name", sorted(AGENTS))
def test_a_hyperparameter_that_an_older_run_lacks_has_its_default(name):
    defaults = {field.name: field.default for field in hyperparameters_of(AGENTS[name])}
    older = RunConfig.from_mapping(SETTINGS | {"algo": {"name": name, "gamma": 0.5}})
    newer = dataclasses.replace(older, algo=defaults | {"name": name, "gamma": 0.5})
    assert newer.differences(older) == older.differences(newer) == []
    other = dataclasses.replace(newer, algo=newer.algo | {"max_grad_norm": 7.0})
    assert other.differences(older) == [
        f"algo.max_grad_norm: 7.0 here, {defaults['max_grad_norm']} there"
    ]


def test_held_actions_count_as_many_environment_steps():
    env = {"name": "halfcheetah", "action_repeat": 4}
    config = RunConfig.from_mapping(SETTINGS | {"env": env, "total_steps": 100_000})
    schedule = config.schedule
    assert schedule.steps_per_iteration == 4 * config.num_envs * config.rollout_length
    assert 0 <= schedule.env_steps - 100_000 < schedule.steps_per_iteration
    with pytest.raises(UsageError, match="must have the same action_repeat"):
        RunConfig.from_mapping(SETTINGS | {"env": env, "second_env": {"name": "hopper"}})


def test_a_pairs_tasks_hold_their_actions_alike():
    config = Settings(["experiment=transfer", "env.action_repeat=5"]).config()
    assert [task["action_repeat"] for task in config.tasks] == [5, 5]
