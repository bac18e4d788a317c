"""`python -m hitmdp_jax video` as a user runs it, and videos while a run goes on."""

import signal
import subprocess
import sys
import types

import imageio_ffmpeg
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hitmdp_jax.cli import video
from hitmdp_jax.cli.video import Videos
from hitmdp_jax.runs.checkpoint import Progress
from tests.cli.conftest import SMALL


@pytest.mark.whole
def test_a_run_is_filmed_into_its_folder(command, finished, tmp_path):
    run_dir, _ = finished
    out = tmp_path / "films"
    arguments = (run_dir, "--episodes", "2", "--seed", "4", "--out", out, "--engine", "native")
    result = command("video", *arguments)
    assert result.returncode == 0, result.stderr
    assert {path.name for path in out.iterdir()} == {"8192_seed4.mp4", "8192_seed4.png"}
    *episodes, saved = result.stdout.splitlines()
    assert saved == f"Saved {out / '8192_seed4.mp4'}, and 8192_seed4.png beside it."
    steps = sum(int(line.split()[3]) for line in episodes)
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(out / "8192_seed4.mp4"))
    assert frames == steps  # 25 a second, every step


def test_each_option_is_filmed_by_itself_side_by_side(command, finished, tmp_path):
    out = tmp_path / "films"
    result = command("video", finished[0], "--options", "--out", out, "--engine", "native")
    assert result.returncode == 0, result.stderr
    *options, saved = result.stdout.splitlines()
    assert [line.split(" alone: ")[0] for line in options] == [
        f"Option {k}" for k in range(len(options))
    ]
    (path,) = out.iterdir()
    assert saved == f"Saved {path}."
    assert path.name.endswith("_options.mp4")
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == max(int(line.split()[3]) for line in options)


@pytest.mark.whole
def test_a_film_in_another_task_is_called_after_it(command, finished, halved, tmp_path):
    """Which pays half as much for the same episodes."""

    def filmed(*more):
        out = tmp_path / f"films{len(more)}"
        arguments = ("--episodes", "2", "--out", out, "--engine", "native", *more)
        result = command("video", finished[0], *arguments)
        assert result.returncode == 0, result.stderr
        episodes = [line.replace(",", "").split() for line in result.stdout.splitlines()[:-1]]
        names = {path.name for path in out.iterdir()}
        return (
            names,
            [int(words[3]) for words in episodes],
            [float(words[6].strip(".")) for words in episodes],
        )

    names, lengths, returns = filmed()
    others = filmed("--env", halved)
    assert (names, others[0]) == (
        {"8192.mp4", "8192.png"},
        {"8192_own.Halved.mp4", "8192_own.Halved.png"},
    )
    assert others[1] == lengths
    assert others[2] == pytest.approx([x / 2 for x in returns], abs=0.06)  # both are rounded


def test_a_video_may_be_given_a_name(command, finished, tmp_path):
    arguments = ("--deterministic", "--episodes", "1", "--out", tmp_path / "a" / "b.mp4")
    result = command("video", finished[0], *arguments)
    assert result.returncode == 0, result.stderr
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"b.mp4", "b.png"}


@pytest.mark.whole
def test_a_run_is_filmed_while_it_goes_on(command, tmp_path):
    """What was filmed is known by environment steps, and TensorBoard shows it."""
    settings = ("env=invertedpendulum", "physics=native", *SMALL, "seeds=2", "seed=3")
    settings += ("total_steps=4096", "video_every=4096", f"run_dir={tmp_path / 'run'}")
    result = command("train", *settings)
    assert (result.returncode, result.stderr) == (0, "")
    folder = tmp_path / "run" / "videos"
    assert {"4096.mp4", "4096.png"} < {path.name for path in folder.iterdir()}
    events = EventAccumulator(str(folder)).Reload()
    assert [picture.step for name in ("filmstrip", "video") for picture in events.Images(name)] == [
        4096,
        4096,
    ]


class Films:
    """`Videos` whose processes run a line of Python instead of the command."""

    def __init__(self, folder, monkeypatch):
        start = subprocess.Popen
        self.code, self.started = "", []

        def begin(command, **how):
            self.started.append(command[command.index("--out") + 1].rsplit("/")[-1])
            return start([sys.executable, "-c", self.code], **how)

        monkeypatch.setattr(video.subprocess, "Popen", begin)
        nothing = types.SimpleNamespace(save=lambda progress: None, close=lambda: None)
        monkeypatch.setattr(video, "Checkpoints", lambda folder: nothing)
        tasks = [{"name": "hopper"}]
        config = types.SimpleNamespace(video_every=1, to_yaml=lambda: "", tasks=tasks)
        self.videos = Videos(config, folder)  # type: ignore

    def due(self, iteration):
        assert self.videos(Progress(iteration, 0, None), 10 * iteration) == {}

    def close(self, requested=False):
        self.videos.close(types.SimpleNamespace(requested=requested))  # type: ignore


@pytest.fixture
def films(tmp_path, monkeypatch):
    return Films(tmp_path, monkeypatch)


def test_a_video_that_is_due_too_early_is_left_out(films, capsys):
    films.code = "input()"  # waits for ever
    films.due(1)
    films.due(2)
    films.close(requested=True)
    assert films.started == ["10.mp4"]
    warning = "warning: no video of 20 env steps: the one before is not finished\n"
    assert capsys.readouterr().err == warning


def test_a_video_that_fails_is_told_and_the_next_one_tried(films, capsys):
    films.code = "import sys; sys.exit('error: no luck')"
    films.due(1)
    films.videos._process.wait()
    films.due(2)
    films.close()
    assert films.started == ["10.mp4", "20.mp4"]
    assert capsys.readouterr().err == 2 * "warning: a video could not be made: no luck\n"


def test_the_end_of_a_run_waits_for_its_video_and_a_signal_does_not(films):
    films.code = "import time; time.sleep(0.2)"
    films.due(1)
    process = films.videos._process
    films.close()
    assert process.returncode == 0
    films.code = "input()"  # waits for ever
    films.due(2)
    process = films.videos._process
    films.close(requested=True)
    assert process.returncode == -signal.SIGKILL
