"""What the command lines set up, in processes of their own: JAX can be set up only once."""

import os
import subprocess
import sys

import pytest

from hitmdp_jax.training.host import SMALL_BATCH

# As many large batches of factorisations at once as wait for one another on a machine of few cores.
FACTORISATIONS = """
import jax, jax.numpy as jnp
from hitmdp_jax.training.host import set_up_host

set_up_host({batch})

def step(x, _):
    factors = [jnp.linalg.cholesky(i * x + 9 * jnp.eye(9)) for i in range(1, 3)]
    return sum(f @ f.mT for f in factors) / 100, None

run = jax.jit(lambda x: jax.lax.scan(step, x, length=50)[0])
x = jnp.broadcast_to(jnp.eye(9), ({batch}, 9, 9))
for _ in range(10):
    x = run(x).block_until_ready()
print(len(jax.local_devices()))
"""


def run(program):
    environment = {name: x for name, x in os.environ.items() if name != "NPROC"}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("batch", [SMALL_BATCH, 4096])
def test_no_batch_hangs(batch):
    out = run(FACTORISATIONS.format(batch=batch))
    assert out.returncode == 0, out.stderr
    assert int(out.stdout) == os.cpu_count()


@pytest.mark.slow
def test_thousands_of_mjx_environments_train(tmp_path):
    settings = "env=halfcheetah num_envs=4096 rollout_length=2 total_steps=8192 algo.num_epochs=1"
    command = [sys.executable, "train.py", *settings.split(), f"hydra.run.dir={tmp_path}"]
    assert subprocess.run(command, timeout=500).returncode == 0
    assert (tmp_path / "metrics.csv").exists()
