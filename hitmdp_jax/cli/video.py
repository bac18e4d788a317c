"""Film a trained run, or one that is training."""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from hitmdp_jax import plugins
from hitmdp_jax.cli.policies import (
    check_output,
    evaluation_key,
    load_chosen,
    load_config,
    on_task,
    output,
)
from hitmdp_jax.cli.waiting import working
from hitmdp_jax.envs import engine_for
from hitmdp_jax.envs.drawing import can_be_drawn, model_of
from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.figures.curves import pixels, save
from hitmdp_jax.interpret.episodes import Trajectories, most_actions, run_episodes
from hitmdp_jax.interpret.evaluation import check_episodes, check_fit, task_env
from hitmdp_jax.interpret.option_use import number_of_options
from hitmdp_jax.physics import find_engine
from hitmdp_jax.runs.checkpoint import Checkpoints, Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import CONFIG, VIDEOS, subfolder, write
from hitmdp_jax.runs.host import set_up_host
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.policy import Policy
from hitmdp_jax.runs.sinks import Values
from hitmdp_jax.runs.sinks.tensorboard import write_pictures
from hitmdp_jax.video.film import animated, require_ffmpeg, write_side_by_side, write_video
from hitmdp_jax.video.filmstrip import filmstrip
from hitmdp_jax.video.rendering import check_drawing

ERRORS = "errors.txt"
ENGINE = "native"  # of videos during a run: the first to be ready


def run(arguments: argparse.Namespace) -> None:
    """Do what `hitmdp video` says; Raises UsageError as what it calls."""
    check_episodes(arguments.episodes)
    config = load_config(arguments)
    shown = on_task(config, arguments.env)
    engine = shown.physics if arguments.engine is None else arguments.engine
    find_engine(engine).check()
    set_up_host(engine, arguments.episodes)
    choice = load_chosen(arguments, config, shown)
    env: Any = task_env(choice.task, engine)
    check_filming(env, choice.task["name"])  # before a folder is made
    check_fit(choice.policy, env)
    if arguments.options:
        number_of_options(choice.policy.agent)  # which says where there are none
    name = f"{choice.name}_options.mp4" if arguments.options else f"{choice.name}.mp4"
    path = output(arguments, VIDEOS, name)
    path = path if path.suffix == ".mp4" else path / name
    strip = path.with_suffix(".png")
    check_output(path, *([] if arguments.options else [strip]))
    key = evaluation_key(choice.training)
    if arguments.options:
        film_options(path, choice.policy, env, key, arguments.deterministic)
        return
    how = {"deterministic": arguments.deterministic, "physics": True}
    with working("playing episodes"):
        recorded = jax.device_get(run_episodes(choice.policy, env, key, arguments.episodes, **how))
    for total, steps in zip(recorded.returns, recorded.lengths, strict=True):
        print(f"An episode of {steps:,} steps, return {total:,.1f}.")
    with working("filming"):
        write_video(path, env, recorded)
    picture = filmstrip(env, recorded, title=f"{choice.title}, episode 1")
    save(picture, strip, dpi=100)
    if arguments.tensorboard:
        shown = {"filmstrip": pixels(picture), "video": animated(path)}
        write_pictures(path.parent, shown, choice.env_steps)
    print(f"Saved {path}, and {strip.name} beside it.")


def film_options(path: Path, policy: Policy, env: Any, key: jax.Array, deterministic: bool) -> None:
    """Film what each option does by itself, side by side from one initial state.

    Raises:
      UsageError: the policy has no options.
    """
    number = number_of_options(policy.agent)
    plans = jnp.broadcast_to(jnp.arange(number)[:, None, None], (number, most_actions(env), 1))

    def run(plan: jax.Array) -> Trajectories:
        how = {"options": plan, "deterministic": deterministic, "physics": True}
        return run_episodes(policy, env, key, 1, **how)

    with working("playing an episode with each option"):
        recorded = jax.device_get(jax.vmap(run)(plans))
    films = [jax.tree.map(lambda x, k=k: x[k], recorded) for k in range(number)]
    for k, film in enumerate(films):
        print(f"Option {k} alone: {film.lengths[0]:,} steps, return {film.returns[0]:,.1f}.")
    with working("filming"):
        write_side_by_side(path, env, films)
    print(f"Saved {path}.")


def check_filming(env: Any, name: str) -> None:
    """Check, before anything is compiled, that a task can be filmed on this machine.

    Args:
      env: the task.
      name: as the settings have it.

    Raises:
      UsageError: saying what is missing.
    """
    if not can_be_drawn(env):
        raise UsageError(
            f"{plugins.label(name)} cannot be filmed: it has no MuJoCo model and no method draw."
        )
    require_ffmpeg()
    if model_of(env) is not None:
        check_drawing()


class Videos:
    """Films the first training's policy while a run goes on, in processes of their own.

    A process gets a copy of what was learned, MuJoCo C and the CPU, so that it neither waits for
    the run's checkpoints nor takes memory of its accelerator. While one is at work no other is
    started: a video that falls due meanwhile is left out. At the run's end the last one is waited
    for, unless a signal asks to stop.

    Args:
      config: the run's settings, `video_every` among them.
      run_dir: the run's folder; videos and filmstrips lie in its `videos/`, by environment steps.
    """

    names = ()

    def __init__(self, config: RunConfig, run_dir: Path):
        self.every = config.video_every
        self._settings, self._run_dir = config.to_yaml(), run_dir
        self._engine = engine_for(config.tasks[0]["name"], ENGINE)
        self._process: subprocess.Popen[bytes] | None = None
        self._copy = tempfile.TemporaryDirectory(prefix="hitmdp_jax_")

    def __call__(self, progress: Progress, env_steps: int) -> Values:
        """Start a video, and return no metric."""
        if self._at_work():
            warn(f"no video of {env_steps:,} env steps: the one before is not finished")
            return {}
        try:
            self._start(progress, env_steps)
        except OSError as error:  # a full disk ends no training
            warn(f"no video of {env_steps:,} env steps: {error}")
        return {}

    def close(self, stop: StopRequest) -> None:
        """Wait for the video under way until it is finished or a signal asks to stop."""
        if self._at_work() and not stop.requested:
            print("Waiting for the last video.", flush=True)
        while self._at_work() and not stop.requested:
            time.sleep(0.1)
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._copy.cleanup()

    def _start(self, progress: Progress, env_steps: int) -> None:
        self._copy.cleanup()
        self._copy = tempfile.TemporaryDirectory(prefix="hitmdp_jax_")
        copy = Path(self._copy.name)
        write(copy / CONFIG, self._settings)
        checkpoints = Checkpoints(copy)
        checkpoints.save(progress)
        checkpoints.close()
        out = subfolder(self._run_dir, VIDEOS) / f"{env_steps}.mp4"
        command = [sys.executable, "-m", "hitmdp_jax", "video", str(copy), "--out", str(out)]
        with (copy / ERRORS).open("w") as errors:
            self._process = subprocess.Popen(
                [*command, "--trust", "--episodes=1", f"--engine={self._engine}", "--tensorboard"],
                env=os.environ | {"JAX_PLATFORMS": "cpu"},
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,  # a terminal's Ctrl-C is the training's to answer
            )

    def _at_work(self) -> bool:
        """Return whether a video is being made; tell of one that failed."""
        if self._process is None:
            return False
        code = self._process.poll()
        if code:
            lines = (Path(self._copy.name) / ERRORS).read_text().strip().splitlines()
            warn("a video could not be made: " + "".join(lines[-1:]).removeprefix("error: "))
        if code is not None:
            self._process = None
        return code is None
