"""`train.py` as a user runs it: in a process of its own."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.policy import restore

TRAIN = Path(__file__).parents[2] / "train.py"
QUICK = ("env=invertedpendulum", "physics=native", "algo.num_epochs=1")


def command(*arguments):
    return [sys.executable, str(TRAIN), *arguments]


@pytest.fixture(scope="module")
def environment():
    cache = jax.config.jax_compilation_cache_dir
    return os.environ | {"JAX_COMPILATION_CACHE_DIR": str(cache), "COLUMNS": "200"}


@pytest.fixture(scope="module")
def train(environment, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")

    def run(*arguments):
        return subprocess.run(
            command(*arguments),
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
        )

    return run


def rows_of(run_dir):
    with (run_dir / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def finished(train, tmp_path_factory):
    run_dir = tmp_path_factory.mktemp("runs") / "run"
    result = train(*QUICK, "seeds=2", "seed=3", "total_steps=8192", f"run_dir={run_dir}")
    assert result.returncode == 0, result.stderr
    return run_dir, result


def test_a_run_leaves_what_it_promises(finished):
    run_dir, result = finished
    first_line = result.stdout.splitlines()[0]
    assert first_line == "mopg on invertedpendulum, physics native on 2 × CPU, 16 envs × 2 seeds"
    names = {p.name for p in run_dir.iterdir()}
    assert {"config.yaml", "metrics.csv", "checkpoints", "figures"} <= names
    assert any(name.startswith("events.out.tfevents") for name in names)
    figures = {p.name for p in (run_dir / "figures").iterdir()}
    assert figures == {"learning_curve.png", "option_durations.png"}
    rows = rows_of(run_dir)
    assert len(rows) == 2 * 4
    assert rows[-1]["env_steps"] == "8192"
    assert [row["seed"] for row in rows[:2]] == ["3", "4"]


def test_the_default_folder_names_env_algorithm_and_time(train, finished):
    defaults = (TRAIN.parent / "configs" / "config.yaml").read_text()
    assert "dir: runs/${env.name}/${algo.name}/${now:" in defaults


def test_load_reads_the_policy_of_a_seed(finished):
    run_dir, _ = finished
    policies = [hitmdp_jax.load(run_dir, seed) for seed in (3, 4)]
    key, obs = jax.random.key(0), jnp.ones(4)
    memory = policies[0].initial_memory(key)
    actions = [p.act(obs, memory, key, deterministic=True)[0] for p in policies]
    assert actions[0].shape == (1,)
    assert not np.allclose(*actions)
    with pytest.raises(hitmdp_jax.UsageError, match="holds 3 to 4"):
        hitmdp_jax.load(run_dir, seed=0)


def test_load_works_where_there_are_fewer_devices(finished):
    """The run was trained on two; a process of one's own has one."""
    run_dir, _ = finished
    code = (
        f"import hitmdp_jax, jax; hitmdp_jax.load({str(run_dir)!r}, 4); print(jax.device_count())"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout == "1\n"


def test_resuming_continues_exactly(train, finished, tmp_path):
    """8192 steps and 8192 more equal 16384 at once, to the last bit of every parameter."""
    run_dir, _ = finished
    whole = tmp_path / "whole"
    arguments = (*QUICK, "seeds=2", "seed=3", "total_steps=16384")
    assert train(*arguments, f"run_dir={whole}").returncode == 0
    result = train(f"resume={run_dir}", "total_steps=16384")
    assert result.returncode == 0, result.stderr
    states = []
    for folder in (whole, run_dir):
        config = RunConfig.load(folder)
        iteration, state = restore(folder, config, config.make_agent())
        assert iteration == 8
        states.append(state.replace(key=jax.random.key_data(state.key)))
    jax.tree.map(np.testing.assert_array_equal, *states)
    without_speed = [
        [{k: v for k, v in row.items() if k != "steps_per_second"} for row in rows_of(folder)]
        for folder in (whole, run_dir)
    ]
    assert without_speed[0] == without_speed[1]


@pytest.mark.timeout(300)
def test_a_transfer_switches_tasks_and_resumes_in_the_second(train, tmp_path):
    run_dir = tmp_path / "run"
    pair = ("experiment=transfer", "pair=cartpole", "algo=ppo", "physics=native")
    result = train(*pair, "algo.num_epochs=1", "total_steps=4096", f"run_dir={run_dir}")
    assert result.returncode == 0, result.stderr
    assert "ppo on dmc/cartpole_balance, then dmc/cartpole_balance_sparse" in result.stdout
    assert [row["env_steps"] for row in rows_of(run_dir)] == ["2048", "4096", "6144", "8192"]
    config = RunConfig.load(run_dir)
    assert restore(run_dir, config, config.make_agent())[0] == 4
    again = train(f"resume={run_dir}")
    assert again.returncode == 0, again.stderr
    assert len(rows_of(run_dir)) == 4


def test_a_resumed_run_keeps_its_settings(train, finished):
    result = train(f"resume={finished[0]}", "algo.gamma=0.5")
    assert result.returncode == 2
    assert "only total_steps can be changed, not 'algo.gamma'" in result.stderr


@pytest.mark.timeout(300)
def test_ten_seeds_finish(train, tmp_path):
    """Batched factorisations and two devices once hung for ever on two cores."""
    result = train(*QUICK, "seeds=10", "total_steps=4096", f"run_dir={tmp_path / 'run'}")
    assert result.returncode == 0, result.stderr
    assert len(rows_of(tmp_path / "run")) == 10 * 2


@pytest.mark.timeout(300)
def test_ctrl_c_saves_what_was_learned(environment, tmp_path):
    run_dir = tmp_path / "run"
    process = subprocess.Popen(
        command(*QUICK, "total_steps=1e9", f"run_dir={run_dir}"),
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (run_dir / "metrics.csv").exists() or len(rows_of(run_dir)) < 3:
        assert process.poll() is None
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert "Stopped at" in out
    assert "Traceback" not in err
    steps = int(rows_of(run_dir)[-1]["env_steps"])
    config = RunConfig.load(run_dir)
    assert restore(run_dir, config, config.make_agent())[0] * 2048 == steps
    hitmdp_jax.load(run_dir)


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("env=halfchetah", "Unknown environment 'halfchetah'; did you mean 'halfcheetah'?"),
        ("algo=mogp", "Unknown algo 'mogp'; did you mean 'mopg'?"),
        ("physics=natve", "Unknown physics 'natve'; did you mean 'native'?"),
        ("num_env=3", "Unknown setting 'num_env'; did you mean 'num_envs'?"),
        ("algo.gama=3", "Unknown setting 'algo.gama'; did you mean 'algo.gamma'?"),
        ("rollout_length=10", "is not divisible by minibatch_size = 64"),
        ("seeds=-1", "seeds = -1 must be a positive whole number"),
        ("algo.learning_rate=-1", "learning_rate = -1.0 must be a number from 0"),
        ("halfcheetah", "'halfcheetah' is not of the form name=value"),
        ("resume=nowhere", "'nowhere' is not a run's folder"),
    ],
)
def test_mistakes_give_one_sentence_and_code_2(train, argument, sentence):
    result = train(argument)
    assert result.returncode == 2
    assert sentence in result.stderr
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stdout == ""


def test_warp_without_its_extra_is_explained(train):
    try:
        import warp  # noqa: F401
    except ImportError:
        result = train("physics=warp")
        assert result.returncode == 2
        assert "pip install -e '.[warp]'" in result.stderr
    else:
        pytest.skip("warp-lang is installed")


def test_importing_is_quick_silent_and_free_of_effects():
    code = (
        "import os, time; before = dict(os.environ); start = time.process_time();"
        "import hitmdp_jax; seconds = time.process_time() - start;"
        "import jax._src.xla_bridge as bridge;"
        "assert not bridge._backends, 'a device was touched';"
        "assert dict(os.environ) == before; assert seconds < 4, seconds"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout == ""
