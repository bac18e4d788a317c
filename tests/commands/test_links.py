"""Links in a run's folder: whatever a command writes there, it writes through none of them."""

import shutil

import pytest

from hitmdp_jax.commands import report
from hitmdp_jax.training import folder
from tests.training.test_folder import contents, plant

EXPORTED = f"{folder.EXPORT}/policy_8192.stablehlo"
FILMED = f"{folder.VIDEOS}/8192.mp4"
DRAWN = f"{folder.FIGURES}/figure6.png"
RESUME = ("train", "resume={}", "total_steps=10240", "report=false")
CASES = [
    (("evaluate", "{}", "--episodes=2"), folder.EVALUATIONS),
    (("report", "{}"), folder.REPORT),
    *(
        (("export", "{}", "--format=stablehlo"), name)
        for name in (folder.EXPORT, EXPORTED, f"{EXPORTED}.json")
    ),
    *((("video", "{}", "--episodes=1"), name) for name in (folder.VIDEOS, FILMED)),
    *((("reproduce", "figure6", "{}"), name) for name in (folder.FIGURES, DRAWN)),
    *((RESUME, name) for name in (folder.METRICS, f"{folder.FIGURES}/learning_curve.png")),
]


@pytest.mark.parametrize(("line", "name"), CASES)
def test_a_command_writes_through_no_link(command, finished, tmp_path, monkeypatch, line, name):
    monkeypatch.setattr(report, "report", lambda *args: "a page")
    run_dir = shutil.copytree(finished[0], tmp_path / "run")
    elsewhere = tmp_path / "elsewhere"
    before = plant(run_dir / name, elsewhere)
    result = command(*(part.format(run_dir) for part in line))
    assert contents(elsewhere) == before
    assert (run_dir / name).is_symlink()
    assert "nothing is written through one" in result.stderr
    assert "Traceback" not in result.stderr
