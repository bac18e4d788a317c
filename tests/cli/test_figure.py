"""`hitmdp figure FIGURE RUN_DIR` as a user runs it."""

import shutil
from argparse import Namespace

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from hitmdp_jax.cli.figure import analysis_of, titled
from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.registry import summaries
from hitmdp_jax.video import pictures
from tests.cli.conftest import QUICK

OF_MODELS = ("contraction", "variance")  # which are drawn of no run
OF_OTHERS = (*OF_MODELS, "regained", "sweep")  # and those of a run whose options they do not show


@pytest.fixture(scope="module")
def run_dir(finished, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures") / "run"
    shutil.copytree(finished[0], folder)
    return folder


def test_a_figure_of_metrics_is_written_and_named(command, run_dir):
    result = command("figure", "figure6", run_dir, "--seed", "4")
    assert result.returncode == 0, result.stderr
    path = run_dir / "figures" / "figure6.png"
    assert result.stdout == f"{path}\n"
    assert path.stat().st_size > 10_000


def test_several_runs_share_a_figure(command, run_dir):
    other = shutil.copytree(run_dir, run_dir.parent / "other")
    result = command("figure", "figure8", run_dir, other)
    assert result.returncode == 0, result.stderr
    assert (run_dir / "figures" / "figure8.png").stat().st_size > 10_000


def test_a_figure_of_episodes_is_written_and_its_table_printed(command, run_dir):
    result = command("figure", "causal", run_dir, "--episodes", "2")
    assert result.returncode == 0, result.stderr
    assert (run_dir / "figures" / "causal.png").stat().st_size > 10_000
    assert all(name in result.stdout for name in ("own choices", "option 3", "minus own"))


def test_a_figure_of_episodes_in_another_task_is_called_after_it(command, run_dir, halved):
    """Which pays half as much for the same episodes."""

    def own_choices(*more):
        result = command("figure", "causal", run_dir, "--episodes", "2", *more)
        assert result.returncode == 0, result.stderr
        lines = result.stdout.splitlines()
        (row,) = [line for line in lines if line.startswith("own choices")]
        return lines[-1], float(row.removeprefix("own choices").split()[0])

    (_, own), (path, half) = own_choices(), own_choices("--env", halved)
    assert path == str(run_dir / "figures" / "causal_own.Halved.png")
    assert half == pytest.approx(own / 2, abs=0.06)


def test_an_episode_is_a_film_where_pictures_can_be_drawn(command, run_dir, monkeypatch):
    path = run_dir / "figures" / "figure10.png"
    result = command("figure", "figure10", run_dir, "--episodes", "2")
    assert (result.returncode, result.stderr) == (0, "")
    with Image.open(path) as filmed:
        assert filmed.width == 1500

    def fail(*_):
        raise UsageError("no luck.")

    monkeypatch.setattr(pictures, "Painter", fail)
    result = command("figure", "figure10", run_dir, "--episodes", "2")
    assert result.stderr == "warning: figure10 shows no pictures: no luck.\n"
    with Image.open(path) as bare:
        assert bare.width == 1050


@pytest.fixture(scope="module")
def without_options(command, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ppo") / "run"
    result = command("train", *QUICK, "total_steps=2048", f"run_dir={folder}")
    assert result.returncode == 0, result.stderr
    return folder


def test_a_figure_of_episodes_says_whose_they_are_above_what_it_says():
    figure = Figure(figsize=(3.0, 2.0), layout="constrained")
    figure.suptitle("No two options are alike.")
    told = "mopg on my$task$, seed 4, 8,192 env steps, 8 episodes"
    titled(figure, told)
    *name, said = figure.get_suptitle().split("\n")
    assert " ".join(name).replace(r"\$", "$") == told
    assert said == "No two options are alike."
    assert all(len(line) <= 39 for line in name)
    np.testing.assert_allclose(figure.get_size_inches(), [3.0, 2.0 + 0.2 * len(name)])


def test_of_a_policy_a_figures_title_names_run_seed_steps_and_episodes(run_dir):
    where = {"trust": False, "env": None, "task": None, "checkpoint": None, "setting": None}
    arguments = Namespace(run_dirs=[run_dir], seed=4, episodes=3, **where)
    title, analysis = analysis_of(arguments)
    assert title == "mopg on invertedpendulum, seed 4, 8,192 env steps, 3 episodes"
    assert analysis.episodes == 3


@pytest.mark.parametrize("name", [name for name in summaries() if name not in OF_OTHERS])
def test_a_run_without_options_is_refused(command, without_options, name):
    result = command("figure", name, without_options)
    assert result.returncode == 2
    assert result.stderr.startswith("error: ")
    assert "no options to look into" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["figure7", "{run}/none"], "'{run}/none' is not a run's folder"),
        (["figure7", "{run}", "--seed", "9"], "seed = 9 is not in the run, which holds 3 to 4."),
        (["figure6", "{run}", "--seed", "9"], "seed = 9 is not in the run, which holds 3 to 4."),
        (["figure7", "{run}", "--checkpoint", "7"], "holds no checkpoint 7; it holds 4"),
        (["sweep", "{run}"], "The run mopg on invertedpendulum sweeps nothing."),
        (["regained", "{run}"], "mopg on invertedpendulum has not switched to a second task."),
        (["regained", "{run}", "--seed", "4"], "--seed has no effect: regained shows all seeds."),
        (["terminations", "{run}"], "MOPG has no termination functions to draw."),
    ],
)
def test_bad_input_is_explained(command, run_dir, arguments, sentence):
    result = command("figure", *(text.format(run=run_dir) for text in arguments))
    assert result.returncode == 2
    assert sentence.format(run=run_dir) in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("name", OF_MODELS)
@pytest.mark.whole
def test_a_figure_of_random_frameworks_is_written(command, tmp_path, name):
    out = tmp_path / "theory" / f"{name}.png"
    result = command("figure", name, "--seed", "1", "--out", out)
    assert (result.returncode, result.stdout) == (0, f"{out}\n"), result.stderr
    assert 10_000 < out.stat().st_size < 150_000
    assert not jax.config.read("jax_enable_x64")  # left as it was


def test_a_run_without_a_checkpoint_says_so(command, run_dir, tmp_path):
    shutil.copytree(run_dir, tmp_path / "run", ignore=lambda *_: ["checkpoints"])
    result = command("figure", "figure12", tmp_path / "run")
    assert result.returncode == 2
    assert "holds no checkpoint" in result.stderr
