"""The printed command of a run, read back by the command line itself."""

import shlex
from pathlib import Path

import hydra
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from hitmdp_jax.cli.command_line import command_line
from hitmdp_jax.cli.settings import Settings, configs

EXAMPLES = Path(__file__).parents[2] / "examples"
OWN_TASK = f"env={EXAMPLES / 'own_task.py'}:Pendulum"
RUNS = {
    "seeds": ["physics=native", "seeds=3", "seed=100"],
    "a preset": ["env.version=v4", "env.ctrl_cost_weight=0.2", "preset=paper"],
    "sizes": ["env=hopper", "algo=dac", "algo.hidden_sizes=[32]", "total_steps=20_480"],
    "a tuned task": ["env=inverteddoublependulum"],
    "a transfer": ["experiment=transfer", "pair=walker1", "physics=native"],
    "a transfer of the cheetah": ["experiment=transfer", "algo=ppo", "env.action_repeat=4"],
    "held actions": ["env=swimmer", "env.action_repeat=5"],
    "a toy": ["env=toy/turkey", "num_envs=4"],
    "a maze": ["env=maze/ant_umaze", "env.reward_type=dense", "env.continuing_task=false"],
    "a task of Brax": ["env=brax/ant", "env.backend=spring"],
    "a sweep": ["env=hopper", "sweep={algo.gamma:[0.98,0.99],algo.clip_eps:[0.1,0.2]}", "seeds=2"],
    "a random sweep": ["sweep={algo.learning_rate:{log_uniform:[1e-5,1e-3]}}", "samples=20"],
    "what stands beside": ["eval_every=1e5", "eval_episodes=3", "video_every=1e6", "wandb=seed"],
    "devices": ["num_envs=8", "data_devices=2", "checkpoint_steps=1e4", "rollout_length=256"],
    "an own algorithm": [f"algo={EXAMPLES / 'own_algorithm.py'}:ClipHigher", "env=hopper"],
    "an own task": [OWN_TASK, "algo.hidden_sizes=[16]"],
}


def read_back(config):
    python, script, *again = shlex.split(command_line(config))
    assert (python, script) == ("python", "train.py")
    return Settings(again).config()


@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_the_command_of_a_run_leads_to_its_settings(run):
    config = Settings(run).config()
    assert read_back(config) == config


@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_settings_are_composed_as_hydra_composes_them_in_one_go(run):
    read = Settings(run)
    with hydra.initialize_config_dir(str(configs().absolute()), version_base="1.3"):
        composed = hydra.compose("config", overrides=read.overrides)
    assert list(read.values().items()) == list(
        OmegaConf.to_container(composed, resolve=True).items()
    )


@pytest.mark.parametrize("plus", ["+", "++"])
def test_hydra_s_plus_before_a_name_changes_nothing(plus):
    plain = ["algo=dac", "total_steps=20_480", "algo.gamma=0.9", "env.version=v4"]
    assert Settings([plus + text for text in plain]).config() == Settings(plain).config()


VALUES = {
    "algo.gamma": st.floats(0.0, 1.0),
    "algo.target_kl": st.sampled_from([0.01, float("inf")]),
    "algo.normalize_values": st.booleans(),
    "algo.mutual_information": st.sampled_from(["none", "action"]),
    "algo.hidden_sizes": st.lists(st.integers(1, 9), min_size=1, max_size=3),
    "env.reset_noise_scale": st.floats(0.0, 1.0),
    "env.version": st.sampled_from(["v4", "v5"]),
    "env.action_repeat": st.integers(1, 9),
    "physics": st.sampled_from(["mjx", "native"]),
    "wandb": st.sampled_from(["off", "program", "seed"]),
    "seed": st.integers(0, 2**31),
    "seeds": st.integers(1, 9),
    "total_steps": st.integers(1, 10**9),
    "eval_every": st.integers(0, 10**6),
    "samples": st.integers(1, 9),
    "sweep": st.fixed_dictionaries(
        {"algo.gae_lambda": st.lists(st.floats(0.0, 1.0), min_size=1, unique=True, max_size=4)}
    ),
}


@settings(max_examples=30)
@given(st.fixed_dictionaries({}, optional=VALUES))
def test_whatever_a_run_sets_is_read_back(given):
    if "sweep" not in given:
        given.pop("samples", None)
    config = Settings([]).config()
    values = config.to_dict()
    for name, value in given.items():
        group, _, own = name.rpartition(".")
        (values[group] if group else values)[own] = value
    config = type(config).from_mapping(values)
    assert read_back(config) == config
