"""What `hitmdp train --help` says of every setting."""

import pytest

from hitmdp_jax.cli import help, tasks
from hitmdp_jax.cli.settings import Settings, configs, dotted
from hitmdp_jax.envs.suites import all_suites

ALGORITHMS = sorted(path.stem for path in (configs() / "algo").glob("*.yaml") if path.stem != "own")
OURS = [name for suite in all_suites() if suite.ours for name in suite.names()]
SETTINGS = [f"algo={name}" for name in ALGORITHMS] + ["preset=paper", "env=toy/turkey"]


@pytest.mark.parametrize("setting", SETTINGS)
def test_every_setting_is_explained_by_a_comment(setting):
    settings = Settings([setting])
    known = help.meanings(settings, settings.jobs()[0])
    names = [name for name, _ in dotted(settings.values()) if name not in help.CHOSEN]
    assert [name for name in (*settings.groups, *names) if not known.get(name)] == []


@pytest.mark.parametrize("name", OURS)
def test_every_keyword_of_a_task_is_explained_by_its_class(name):
    explained = tasks.keywords(name)
    assert explained.keys() == tasks.defaults(name).keys()
    assert all(explained.values())


def test_the_help_shows_values_and_meanings_of_what_was_chosen():
    text = " ".join(help.text(Settings(["env=hopper", "algo=ppo", "seeds=3"])).split())
    assert "seeds=3 number of independent trainings, all in one program" in text
    assert "algo.gae_lambda=0.95 lambda of generalised advantage estimation (GAE)" in text
    assert "env.healthy_reward reward of a healthy step" in text
    assert (
        "preset configs/preset: named sets of changes, applied last: none, off_policy_gpu, "
        "own_rewards, paper" in text
    )
    assert "num_options" not in text


def test_a_comment_belongs_to_its_setting(tmp_path):
    file = tmp_path / "some.yaml"
    file.write_text("# @package _global_\na: 1  # one\nalgo:\n  b: [1] # two\n  c: x\nd: 4 # 4\n")
    assert help.comments(file, "algo.") == {
        "a": "one", "algo.b": "two", "algo.c": "", "d": "4"
    }  # fmt: skip
    file.write_text("# An algorithm\nb: 1 # one\n")
    assert help.comments(file, "algo.") == {"algo.b": "one"}
