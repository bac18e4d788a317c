"""`train.py` as a user runs it."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import jax
import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hitmdp_jax.cli.jobs import sweep_folder
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.cli.training import train
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.checkpoint import Checkpoints, saved_iterations
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.run import Run
from tests.cli.conftest import (
    CHECKOUT,
    FINISHED,
    QUICK,
    SMALL,
    rows_of,
    signal_after_rows,
    wait_for_rows,
)
from tests.signals import signals_heard


def restore(run_dir):
    checkpoints = Checkpoints(run_dir, read_only=True)
    try:
        return Run.create(RunConfig.load(run_dir)).restore(checkpoints)
    finally:
        checkpoints.close()


def assert_same_run(one, other):
    """Equal to the last bit of every parameter, and row by row but for the speed."""
    states = []
    for folder in (one, other):
        state = restore(folder).state
        states.append(state.replace(key=jax.random.key_data(state.key)))
    jax.tree.map(np.testing.assert_array_equal, *states)
    without_speed = [
        [{k: v for k, v in row.items() if k != "steps_per_second"} for row in rows_of(folder)]
        for folder in (one, other)
    ]
    assert without_speed[0] == without_speed[1]


def test_a_run_leaves_what_it_promises(finished):
    run_dir, result = finished
    lines = result.stdout.splitlines()
    assert lines[0] == "mopg on invertedpendulum, physics native on 2 × CPU, 16 envs × 2 seeds"
    assert lines[1] == "compiling ..."
    assert lines[-2] == f"Saved in {run_dir}."
    score = r"-?\d+\.\d+ \(interquartile mean of 2 seeds\)\."
    assert re.fullmatch(f"Return of all 8,192 steps: {score}", lines[-1])
    assert lines[-3].startswith("8,192 steps (100%), ")
    names = {p.name for p in run_dir.iterdir()}
    expected = {
        "config.yaml", "metrics.csv", "evaluations.csv", "checkpoints", "figures", "made_with.txt"
    }  # fmt: skip
    assert expected <= names
    assert any(name.startswith("events.out.tfevents") for name in names)
    figures = {p.name for p in (run_dir / "figures").iterdir()}
    assert figures == {"learning_curve.png", "option_durations.png"}
    rows = rows_of(run_dir)
    assert len(rows) == 2 * 4
    assert rows[-1]["env_steps"] == "8192"
    assert [row["seed"] for row in rows[:2]] == ["3", "4"]
    assert [bool(row["evaluation_return"]) for row in rows[::2]] == [False, True, False, True]
    evaluations = rows_of(run_dir, "evaluations.csv")
    assert [(e["iteration"], e["seed"]) for e in evaluations] == [
        ("2", "3"), ("2", "4"), ("4", "3"), ("4", "4")
    ]  # fmt: skip
    assert float(evaluations[-1]["return"]) == pytest.approx(
        float(rows[-1]["evaluation_return"]), rel=1e-4
    )


@pytest.mark.whole
def test_the_default_folder_names_env_algorithm_and_time_and_is_taken_once(command, tmp_path):
    arguments = (*QUICK, "total_steps=2048")
    for _ in range(2):
        assert command("train", *arguments, cwd=tmp_path).returncode == 0
    (folder,) = (tmp_path / "runs" / "invertedpendulum").iterdir()
    assert folder.name == "ppo"
    assert len(list(folder.iterdir())) == 2
    again = command("train", "resume=latest", cwd=tmp_path)
    assert again.returncode == 0
    assert "is finished: 2,048 env steps" in again.stdout
    assert not (tmp_path / "multirun.yaml").exists()


def test_resuming_continues_exactly(command, finished, tmp_path):
    """8192 steps and 8192 more equal 16384 at once."""
    run_dir = shutil.copytree(finished[0], tmp_path / "run")
    whole = tmp_path / "whole"
    assert command("train", *FINISHED, "total_steps=16384", f"run_dir={whole}").returncode == 0
    result = command("train", f"resume={run_dir}", "total_steps=16384", "report=false")
    assert result.returncode == 0, result.stderr
    assert restore(run_dir).iteration == 8
    assert_same_run(whole, run_dir)
    events = EventAccumulator(str(run_dir)).Reload().Scalars("train/value")
    assert [event.step for event in events] == [2048 * i for i in range(1, 9)]


@pytest.mark.whole
def test_a_run_that_began_with_another_resumes_without_beginning_with_it_again(
    command, finished, tmp_path
):
    """Nor is the source read: it is gone by then."""
    source = shutil.copytree(finished[0], tmp_path / "source")
    arguments = (*FINISHED, f"init_from={source}", "init_parts=policy,normalizer")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    result = command("train", *arguments, "total_steps=8192", f"run_dir={whole}")
    begins = f"Begins with 2 trainings in {source}, after iteration 4; starting anew: critic"
    assert begins in result.stdout
    command("train", *arguments, "total_steps=4096", f"run_dir={parts}")
    shutil.rmtree(source)
    result = command("train", f"resume={parts}", "total_steps=8192", "report=false")
    assert result.returncode == 0, result.stderr
    assert "Begins with" not in result.stdout
    assert_same_run(whole, parts)


def test_a_finished_run_says_so(command, finished):
    before = sorted(finished[0].rglob("*"))
    result = command("train", f"resume={finished[0]}")
    assert result.returncode == 0
    assert result.stdout.startswith(f"{finished[0]} is finished: 8,192 env steps.")
    assert sorted(finished[0].rglob("*")) == before


@pytest.mark.whole
def test_a_transfer_switches_tasks_and_resumes_on_either_side(command, tmp_path):
    """Two seeds, so that a state restored at the switch has to find its two devices."""
    pair = ("experiment=transfer", "pair=cartpole", "algo=ppo", "physics=native", "seeds=2")
    settings = (*pair, *SMALL, "total_steps=4096", "checkpoint_steps=2048")
    settings += ("eval_every=4096", "eval_episodes=1")
    whole = tmp_path / "whole"
    result = command("train", *settings, f"run_dir={whole}")
    assert result.returncode == 0, result.stderr
    assert "ppo on dmc/cartpole_balance, then dmc/cartpole_balance_sparse" in result.stdout
    steps = [row["env_steps"] for row in rows_of(whole)[::2]]
    assert steps == ["2048", "4096", "6144", "8192"]
    assert restore(whole).task == 1
    # A policy is scored on the task that it was on. The sparse one's returns are whole numbers.
    assert command("evaluate", whole, "--episodes=1", "--checkpoint=2").returncode == 0
    rows = rows_of(whole, "evaluations.csv")
    tasks = ["dmc/cartpole_balance", "dmc/cartpole_balance_sparse"]
    assert [(row["iteration"], row["task"]) for row in rows[::2]] == [
        ("2", tasks[0]), ("4", tasks[1]), ("2", tasks[0])
    ]  # fmt: skip
    whole_numbers = [float(row["return"]).is_integer() for row in rows]
    assert whole_numbers == [row["task"] == tasks[1] for row in rows]
    for checkpoint, task in zip((2, 4), tasks, strict=True):
        path = tmp_path / f"{checkpoint}.stablehlo"
        arguments = (f"--checkpoint={checkpoint}", f"--out={path}", "--format=stablehlo")
        command("export", whole, *arguments)
        assert json.loads(path.with_name(f"{path.name}.json").read_text())["task"]["name"] == task
    for last in (2, 3):  # at the switch, and past it
        part = shutil.copytree(whole, tmp_path / f"until_{last}")
        for iteration in saved_iterations(part):
            if iteration > last:
                shutil.rmtree(part / "checkpoints" / str(iteration))
        again = command("train", f"resume={part}", "report=false")
        assert again.returncode == 0, again.stderr
        assert_same_run(whole, part)
    moved = command("train", f"resume={whole}", "total_steps=8192")
    assert moved.returncode == 2
    assert "they cannot be changed" in moved.stderr


def test_a_task_without_its_extra_makes_no_folder(monkeypatch, tmp_path):
    folder = tmp_path / "run"
    values = Settings(["experiment=transfer", "pair=cheetah", f"run_dir={folder}"]).values()
    monkeypatch.setattr("hitmdp_jax.envs.suites.base.importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match="needs the extra 'dmc'"):
        train(values, [])
    assert not folder.exists()


@pytest.mark.whole
def test_ten_seeds_finish(command, tmp_path):
    """Batched factorisations and two devices once hung for ever on two cores."""
    arguments = (*QUICK, "seeds=10", "total_steps=4096")
    result = command("train", *arguments, f"run_dir={tmp_path / 'run'}")
    assert result.returncode == 0, result.stderr
    assert len(rows_of(tmp_path / "run")) == 10 * 2


@pytest.mark.parametrize(
    ("signum", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_saves_what_was_learned(command, tmp_path, signum, code):
    run_dir = tmp_path / "run"
    with signal_after_rows(signum, run_dir):
        result = command("train", *QUICK, "total_steps=1e9", f"run_dir={run_dir}")
    assert result.returncode == code, result.stderr
    assert "Stopped at" in result.stdout
    assert f"resume={run_dir}" in result.stdout
    assert "Traceback" not in result.stderr
    steps = int(rows_of(run_dir)[-1]["env_steps"])
    assert max(saved_iterations(run_dir)) * 2048 == steps


def test_a_run_whose_folder_is_moved_away_does_not_claim_to_be_saved_there(command, tmp_path):
    run_dir = tmp_path / "run"

    def move():
        wait_for_rows(run_dir, 3)
        run_dir.rename(tmp_path / "elsewhere")
        os.kill(os.getpid(), signal.SIGINT)

    with signals_heard():
        threading.Thread(target=move, daemon=True).start()
        result = command("train", *QUICK, "total_steps=1e9", f"run_dir={run_dir}")
    assert result.returncode == 2, result.stderr
    assert "The last state is not saved" in result.stderr
    assert "saved in" not in result.stdout
    assert "Traceback" not in result.stderr
    assert not run_dir.exists()


ARRAYS_AT_IMPORT = """
import jax.numpy as jnp
from hitmdp_jax.agents import PPO
from hitmdp_jax.envs.suites.toy.turkey import Turkey

RAW, EPSILON = jnp.array([1.0, 0.0]), jnp.float32(1e-5)

class Task(Turkey):
    pass

class Own(PPO):
    pass
"""


@pytest.mark.whole
def test_a_second_signal_stops_at_once_also_files_that_make_arrays_when_they_are_imported(
    start, tmp_path
):
    """In processes of their own: JAX can be set up only before it computes. The run is read."""
    (tmp_path / "own.py").write_text(ARRAYS_AT_IMPORT)
    own = ("env=own.py:Task", "algo=own.py:Own", *SMALL, "seeds=2", "run_dir=run")
    process = start("train", *own, "total_steps=1e9", "checkpoint_steps=2048")
    wait_for_rows(tmp_path / "run", 8, process)
    process.send_signal(signal.SIGINT)
    while "Stopping and saving after this iteration" not in process.stderr.readline():
        assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    process.communicate()
    assert process.returncode in (-signal.SIGTERM, -signal.SIGINT, 130)
    assert restore(tmp_path / "run").iteration >= 1
    scored = start("evaluate", "run", "--episodes=2")
    _, err = scored.communicate()
    assert scored.returncode == 0, err


@pytest.mark.whole
def test_a_signal_while_compiling_is_heard(start, tmp_path):
    process = start("train", "env=walker2d", "algo=ppo", f"run_dir={tmp_path / 'run'}")
    assert "ppo on walker2d" in process.stdout.readline()
    assert process.stdout.readline() == "compiling ...\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert process.returncode == 130, err
    assert "Stopped before the first iteration" in out


def test_a_run_is_not_overwritten_unless_asked(command, tmp_path):
    run_dir = tmp_path / "run"
    arguments = (*QUICK, f"run_dir={run_dir}")
    assert command("train", *arguments, "total_steps=4096").returncode == 0
    refused = command("train", *arguments, "total_steps=2048")
    assert refused.returncode == 2
    assert "already holds a run: resume=" in refused.stderr
    assert saved_iterations(run_dir) == [2]
    assert command("train", *arguments, "total_steps=2048", "overwrite=true").returncode == 0
    assert saved_iterations(run_dir) == [1]
    assert len(rows_of(run_dir)) == 1


def test_jobs_that_a_launcher_sends_elsewhere_are_not_held_to_this_machines_memory(
    tmp_path, monkeypatch
):
    """A launcher of Hydra's stands for one that an installation adds."""
    monkeypatch.chdir(tmp_path)
    arguments = [*QUICK, "seed=0,1", "seeds=1e9", "run_dir=sweep"]
    with pytest.raises(UsageError, match="of memory, most of it for seeds"):
        sweep_folder(Settings(arguments, multirun=True))
    assert not Path("sweep").exists()
    elsewhere = Settings([*arguments, "hydra/launcher=basic"], multirun=True)
    assert sweep_folder(elsewhere) == Path("sweep")


def test_a_sweep_checks_every_job_first_and_resumes(command, tmp_path):
    """Its third job has a huge learning rate: the loss overflows after the first iteration."""
    arguments = ("-m", *QUICK, "total_steps=6144", f"run_dir={tmp_path / 'sweep'}")
    wrong = command("train", *arguments, "algo.learning_rate=3e-4,abc")
    assert wrong.returncode == 2
    assert "algo.learning_rate = abc must be a number" in wrong.stderr
    assert not (tmp_path / "sweep").exists()
    right = command("train", *arguments, "algo.learning_rate=3e-4,1e-3")
    assert right.returncode == 0, right.stderr
    folders = {p.name for p in (tmp_path / "sweep").iterdir() if p.is_dir()}
    assert folders == {"algo.learning_rate=0.0003", "algo.learning_rate=0.001"}
    assert "job 2: algo.learning_rate=0.001" in right.stdout
    again = command("train", *arguments, "algo.learning_rate=3e-4,1e-3,1e38")
    assert again.stdout.count("is finished") == 2
    assert_frozen_and_told(again, tmp_path / "sweep" / "algo.learning_rate=1e+38")


def assert_frozen_and_told(result, run_dir):
    assert result.returncode == 3, result.stderr
    assert "seed 0 diverged at iteration 2, when its loss was no longer finite" in result.stderr
    rows = rows_of(run_dir)
    assert [row["diverged"] for row in rows] == ["0", "1", "1"]
    assert [row["value_loss"] == "" for row in rows] == [False, True, True]
    state = restore(run_dir).state
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(state.learner.params))


def test_a_run_whose_last_checkpoint_is_torn_is_not_finished(command, tmp_path):
    """It goes on from the checkpoint before, to where it was."""
    run_dir = tmp_path / "run"
    settings = (*QUICK, "total_steps=4096", "checkpoint_steps=2048", f"run_dir={run_dir}")
    assert command("train", *settings).returncode == 0
    whole = shutil.copytree(run_dir, tmp_path / "whole")
    for path in (run_dir / "checkpoints" / "2" / "state").rglob("*"):
        if path.is_file():  # which of its last bytes are read depends on the order of writing
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    result = command("train", f"resume={run_dir}", "report=false")
    assert result.returncode == 0, result.stderr
    assert result.stderr.count("checkpoint of iteration 2") == 1
    assert f"Saved in {run_dir}" in result.stdout
    assert_same_run(whole, run_dir)
    assert "is finished" in command("train", f"resume={run_dir}").stdout


@pytest.mark.whole
def test_own_task_and_algorithm_train_resume_evaluate_and_load(command, tmp_path):
    task = CHECKOUT / "examples" / "own_task.py"
    algo = CHECKOUT / "examples" / "own_algorithm.py"
    names = {}
    for path in (task, algo):
        shutil.copy(path, tmp_path / path.name)
        names[path] = f"{path.name}:{_class_in(path)}"
    run_dir = tmp_path / "run"
    settings = (f"env={names[task]}", f"algo={names[algo]}", "physics=native", "total_steps=2048")
    settings += SMALL
    result = command("train", *settings, f"run_dir={run_dir}", "algo.gamma=0.9", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert RunConfig.load(run_dir).algo["gamma"] == 0.9
    more = (f"resume={run_dir}", "total_steps=4096", "report=false")
    resumed = command("train", *more)  # from another folder
    assert resumed.returncode == 0, resumed.stderr
    scored = command("evaluate", run_dir, "--episodes", "2", "--json")
    assert scored.returncode == 0, scored.stderr
    assert len(json.loads(scored.stdout)) == 1
    wrong = command("train", f"env={task}:Nothing")
    assert wrong.returncode == 2
    assert "Unknown class of" in wrong.stderr


def _class_in(path):
    """Return the name of the class that an example's first line names."""
    lines = path.read_text().splitlines()
    return next(x.split()[1].split("(")[0].strip(":") for x in lines if x.startswith("class "))


def test_errors_of_a_users_own_code_keep_their_traceback(command, tmp_path):
    (tmp_path / "broken.py").write_text("import nothing_of_that_name\n")
    result = command("train", "env=broken.py:Task", cwd=tmp_path)
    assert result.returncode == 1
    assert "Traceback" in result.stderr
    assert "No module named 'nothing_of_that_name'" in result.stderr


@pytest.mark.whole
def test_importing_is_quick_silent_and_free_of_effects_and_set_up_heeds_the_cores(variables):
    """In a process of its own, which may use one core. Nothing else is imported."""
    code = (
        "import os, sys; before = dict(os.environ);"
        "import brax.envs.base, distrax, flax, jax, optax, orbax.checkpoint;"
        "libraries = {name.split('.')[0] for name in sys.modules};"
        "import hitmdp_jax; [getattr(hitmdp_jax, name) for name in hitmdp_jax.__all__];"
        "more = {name.split('.')[0] for name in sys.modules} - libraries;"
        "more -= {'hitmdp_jax'} | sys.stdlib_module_names; assert not more, more;"
        "import jax._src.xla_bridge as bridge;"
        "assert not bridge._backends, 'a device was touched';"
        "assert dict(os.environ) == before;"
        "from hitmdp_jax.runs.host import set_up_host; set_up_host('native', 16);"
        "print(jax.local_device_count())"
    )
    command = ["taskset", "-c", "0", sys.executable, "-c", code]
    environment = os.environ | variables | {"PYTHONPATH": str(CHECKOUT)}
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout == "1\n"
