"""Every task of a suite is a choice of the command line, without a file of its own."""

import inspect

import pytest
import yaml
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.cli.tasks import store_tasks
from hitmdp_jax.envs import check_env, list_envs

# One of each; asking a library for the keywords of all of its tasks takes long.
OF_LIBRARIES = (
    "brax/ant",
    "gymnax/FourRooms-misc",
    "xminigrid/MiniGrid-Empty-5x5",
    "craftax/Craftax-Symbolic-v1",
    "playground/CheetahRun",
)


@pytest.mark.parametrize("name", [*list_envs(), *OF_LIBRARIES])
def test_a_task_is_stored_with_the_defaults_of_its_constructor(name):
    assert name in store_tasks()
    node = OmegaConf.to_container(ConfigStore.instance().load(f"env/{name}.yaml").node)
    assert node.pop("name") == name
    parameters = inspect.signature(check_env(name, **node)).parameters
    assert node.keys() <= parameters.keys() - {"physics"}
    for keyword, value in node.items():
        default = parameters[keyword].default
        assert value == (list(default) if isinstance(default, tuple) else default)
    assert yaml.safe_load(yaml.safe_dump(node)) == node  # as a run's folder keeps them


@pytest.mark.parametrize(
    ("arguments", "keywords"),
    [
        (["env=brax/fast"], {"name": "brax/fast"}),
        (["env=maze/point_umaze"], {"name": "maze/point_umaze", "reward_type": "sparse"}),
        (["env=walker2d", "env.healthy_reward=2"], {"healthy_reward": 2, "version": "v5"}),
        (["pair=cheetah"], {"name": "dmc/cheetah_run"}),
        ([], {"name": "halfcheetah", "ctrl_cost_weight": 0.1}),
    ],
    ids=" ".join,
)
def test_a_command_line_takes_any_task(arguments, keywords):
    env = Settings(arguments).config().env
    assert env.items() >= keywords.items()


def test_what_is_tuned_for_a_task_goes_with_it():
    tuned, plain = (Settings([f"env={name}"]).values() for name in ("toy/turkey", "reacher"))
    assert tuned["algo"] != plain["algo"]
