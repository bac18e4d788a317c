"""`python -m hitmdp_jax study` as a user runs it."""

import pytest
import yaml

from hitmdp_jax.cli import arms, study
from tests.cli.conftest import QUICK


@pytest.mark.parametrize("name", study.names())
def test_the_studies_that_come_with_the_package_are_valid(name):
    read = study.read(name)
    settings = {arm: [*read.settings, *own] for arm, own in read.arms.items()}
    assert all(config.seeds >= 16 for config in arms.configs_of(settings).values())


def test_a_study_of_ones_own_is_trained_and_noted_down(command, tmp_path, arms_here):
    """Its arms are trained in this process; that they have one of their own is tested elsewhere."""
    own = {
        "question": "Does discounting matter?",
        "control": "long",
        "settings": [*QUICK, "total_steps=2048"],
        "arms": {"long": [], "short, 10 steps": ["algo.gamma=0.9"]},
    }
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(own))
    arguments = ["own.yaml", f"run_dir={tmp_path / 'found'}", "append=notebook.md"]
    result = command("study", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    notebook = (tmp_path / "notebook.md").read_text()
    table = (tmp_path / "found" / "study.md").read_text()
    assert "| short, 10 steps |" in table
    assert notebook.startswith("\n## Does discounting matter?")
    assert notebook.endswith(table)
    again = command("study", *arguments, cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert ["is finished: 2,048" in arm.stdout for arm in arms_here] == [False, False, True, True]
