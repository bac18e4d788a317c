"""What the command lines set up. JAX can be set up only once: one process of its own shows it."""

import os
import subprocess
import sys

import jax
import pytest

from hitmdp_jax.machine import available_cores
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.host import set_up_host, solver_of

# As many large batches of factorisations at once as wait for one another on a machine of few cores.
FACTORISATIONS = """
import jax, jax.numpy as jnp
from hitmdp_jax.runs.host import set_up_host

set_up_host("mjx", 4096, trainings=64)

def step(x, _):
    factors = [jnp.linalg.cholesky(i * x + 9 * jnp.eye(9)) for i in range(1, 3)]
    return sum(f @ f.mT for f in factors) / 100, None

run = jax.jit(lambda x: jax.lax.scan(step, x, length=20)[0])
x = jnp.broadcast_to(jnp.eye(9), (4096, 9, 9))
for _ in range(5):
    x = run(x).block_until_ready()
print(len(jax.local_devices()))
"""


def run(command):
    environment = {name: x for name, x in os.environ.items() if name != "NPROC"}
    out = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert out.returncode == 0, out.stderr
    return out


@pytest.mark.whole
def test_large_batches_of_factorisations_do_not_hang():
    out = run([sys.executable, "-c", FACTORISATIONS])
    assert int(out.stdout) == available_cores()


@pytest.mark.parametrize(("trainings", "data"), [(1, 1), (2, 1), (1, 2), (3, 2)])
def test_no_more_devices_and_threads_than_trainings_take(monkeypatch, trainings, data):
    """What XLA is asked for, which it gives where nothing has been computed (the test above)."""
    settings = {}
    monkeypatch.setattr(jax.config, "update", settings.__setitem__)
    monkeypatch.delenv("NPROC")
    set_up_host("native", 16, trainings, data)
    expected = data * min(trainings, max(1, available_cores() // data))
    assert settings["jax_num_cpu_devices"] == expected
    assert os.environ["NPROC"] == str(expected)


def test_no_more_devices_are_made_than_any_machine_has_cores(monkeypatch):
    settings = {}
    monkeypatch.setattr(jax.config, "update", settings.__setitem__)
    set_up_host("native", 10**9, data_devices=10**9)
    assert settings["jax_num_cpu_devices"] == available_cores()


@pytest.mark.slow
def test_thousands_of_mjx_environments_train(tmp_path):
    settings = "env=halfcheetah num_envs=4096 rollout_length=2 total_steps=8192 algo.num_epochs=1"
    run([sys.executable, "train.py", *settings.split(), f"run_dir={tmp_path}"])
    assert (tmp_path / "checkpoints").exists()


@pytest.mark.whole
def test_a_file_that_computes_at_its_import_leaves_no_run_without_the_threads_it_needs():
    code = (
        "import jax; from hitmdp_jax.runs.host import present_cores, set_up_host;"
        "present_cores(); jax.numpy.zeros(1); set_up_host('native', 16, 2);"
        "print(len(jax.local_devices())); set_up_host('mjx', 4096)"
    )
    environment = {name: x for name, x in os.environ.items() if name != "NPROC"}
    command = [sys.executable, "-c", code]
    out = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert int(out.stdout) == available_cores()
    assert "make the arrays in the class, or with NumPy" in out.stderr


@pytest.mark.parametrize(
    ("task", "solver"), [("gymnax/CartPole-v1", None), ("toy/cue", None), ("hopper", "mjx")]
)
def test_only_tasks_that_solve_equations_ask_for_threads(task, solver):
    """gymnax starts JAX when it is imported, and so nothing could be set up for its tasks."""
    config = RunConfig.from_mapping({"env": {"name": task}, "algo": {"name": "ppo"}})
    assert solver_of(config, "mjx") == solver
    set_up_host(solver_of(config, "mjx"), 64 if solver else 10_000)
