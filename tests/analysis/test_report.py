import pytest

from hitmdp_jax.analysis.report import command
from hitmdp_jax.commands.settings import Settings

RUNS = (
    ["env=halfcheetah", "physics=native", "seeds=3", "seed=100"],
    ["env=halfcheetah", "env.version=v4", "env.ctrl_cost_weight=0.2", "preset=paper"],
    ["env=hopper", "algo=dac", "algo.hidden_sizes=[32]", "algo.gamma=0.9", "total_steps=20_480"],
    ["experiment=transfer", "pair=walker1", "physics=native"],
    ["env=toy/turkey", "num_envs=4"],
)


@pytest.mark.parametrize("settings", RUNS, ids=lambda settings: settings[0] + settings[1])
def test_the_command_of_a_run_leads_to_its_settings(settings):
    config = Settings(settings).config()
    python, script, *again = command(config).split(" ")
    assert (python, script) == ("python", "train.py")
    assert Settings(again).config() == config
