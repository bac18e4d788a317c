"""Which policy a command line names, and the task that it is looked at in."""

from hitmdp_jax.cli.policies import Chosen, file_name, on_task
from hitmdp_jax.runs.config import RunConfig
from tests.probes import QUICK

SWEPT = {
    "env": {"name": "toy/turkey", "action_repeat": 2},
    "physics": "mjx",
    "sweep": {"env.stuffed_reward": [5.0, 20.0]},
}


def test_a_setting_takes_its_numbers_to_its_own_task_and_not_to_another():
    config = RunConfig.from_mapping(QUICK | SWEPT)
    training = config.trainings[1]
    own, other = (
        Chosen(config, training, 4, None, "", on_task(config, name))  # type: ignore
        for name in (None, "toy/cue")
    )
    assert own.task == {"name": "toy/turkey", "action_repeat": 2, "stuffed_reward": 20.0}
    assert other.task == {"name": "toy/cue", "length": 10, "action_repeat": 2}
    assert own.title.endswith(f"{training.name}, {own.env_steps:,} env steps")
    assert other.title == f"{own.title}, in toy/cue"


def test_a_file_is_called_after_a_task_without_folders():
    assert file_name("causal", "toy/cue") == "causal_toy-cue"
    assert file_name("report", "a/my.py:Task") == "report_my.Task"
    assert file_name("report", None) == "report"
