import os
import subprocess
import sys
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.physics import host_call
from tests.cli.conftest import variables

__all__ = ["variables"]  # a fixture


class Sums:
    """Writes the sum and the product of every row; keeps what it was called with."""

    def __init__(self):
        self.shapes, self.threads = [], set()

    def __call__(self, rows, out):
        assert rows.dtype == out.dtype == np.float32
        if np.isnan(rows).any():
            raise ValueError("a row is not a number")
        self.shapes.append(rows.shape)
        self.threads.add(threading.get_ident())
        out[:, 0], out[:, 1] = rows.sum(1), rows.prod(1)


@pytest.fixture
def sums(request):
    function = Sums()
    name = f"test.{request.node.name}"
    host_call.register(name, function)
    return function, lambda row: host_call.call(name, row, 2, function)


@pytest.mark.parametrize("shape", [(3,), (4, 3), (2, 5, 3), (70_000, 3)])
def test_every_vmap_ends_up_in_one_call(sums, shape):
    function, call = sums
    x = jax.random.normal(jax.random.key(0), shape)
    mapped = call
    for _ in shape[:-1]:
        mapped = jax.vmap(mapped)
    for apply in (mapped, jax.jit(mapped)):
        out = apply(x)
        np.testing.assert_allclose(out, np.stack([x.sum(-1), x.prod(-1)], -1), atol=1e-5)
    assert function.shapes == [(int(np.prod(shape[:-1])), 3)] * 2


def test_a_loop_calls_once_a_step_and_in_order(sums):
    function, call = sums
    final = jax.jit(lambda x: jax.lax.fori_loop(0, 5, lambda _, x: call(x), x))
    np.testing.assert_allclose(final(jnp.ones(2)), _five_sums())
    assert len(function.shapes) == 5


def _five_sums():
    x = np.ones(2)
    for _ in range(5):
        x = np.array([x.sum(), x.prod()])
    return x


def test_an_exception_reaches_the_caller(sums):
    _, call = sums
    with pytest.raises(Exception, match=r"ValueError: a row is not a number"):
        jax.block_until_ready(jax.jit(call)(jnp.full(3, jnp.nan)))


def test_a_name_keeps_its_first_function(sums):
    function, call = sums
    host_call.register("test.test_a_name_keeps_its_first_function", lambda *_: 1 / 0)
    jax.jit(call)(jnp.ones(3)).block_until_ready()
    assert function.shapes


DEVICES = """
import jax, jax.numpy as jnp
from hitmdp_jax.physics import host_call

jax.config.update("jax_num_cpu_devices", 2)

def halve(rows, out):
    out[:] = rows / 2

host_call.register("test.halve", halve)
step = jax.vmap(jax.vmap(lambda x: host_call.call("test.halve", x, 30, halve)))
run = jax.jit(lambda x: jax.lax.fori_loop(0, 50, lambda _, x: step(x), x))
x = jnp.ones((2, 20_000, 30))
mesh = jax.make_mesh((2,), ("x",), (jax.sharding.AxisType.Auto,))
spec = jax.sharding.PartitionSpec("x")
run = jax.jit(jax.shard_map(run, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False))
for _ in range(10):
    out = run(x).block_until_ready()
print(float(out.max()) == 0.5**50)
"""


@pytest.mark.whole
def test_devices_call_it_at_the_same_time():
    """Large matrices, and as many devices as threads: `pure_callback` waits for ever here."""
    environment = os.environ | {"NPROC": "2"}
    out = subprocess.run(
        [sys.executable, "-c", DEVICES], env=environment, capture_output=True, text=True
    )
    assert out.stdout == "True\n", out.stderr


def test_other_platforms_call_it_on_the_host(sums, monkeypatch):
    """No CPU can lower for a GPU: here the branch for other platforms runs on the CPU."""
    function, call = sums
    monkeypatch.setattr(jax.lax, "platform_dependent", lambda row, cpu, default: default(row))
    x = jax.random.normal(jax.random.key(0), (2, 5, 3))
    out = jax.jit(jax.vmap(jax.vmap(call)))(x)
    np.testing.assert_allclose(out, np.stack([x.sum(-1), x.prod(-1)], -1), atol=1e-5)
    assert function.shapes == [(10, 3)]


@pytest.mark.whole
def test_programs_are_taken_from_the_compilation_cache(tmp_path, variables):
    """A second process compiles nothing that steps `physics=native`."""
    code = (
        "import jax; from hitmdp_jax import make_env;"
        f"jax.config.update('jax_compilation_cache_dir', {str(tmp_path)!r});"
        "jax.config.update('jax_persistent_cache_min_compile_time_secs', 0.0);"
        "hits = []; jax.monitoring.register_event_listener(lambda event, **_: hits.append(event));"
        "env = make_env('hopper', physics='native');"
        "step = jax.jit(lambda key: env.step(env.reset(key), jax.numpy.zeros(3)).obs);"
        "obs = step(jax.random.key(0));"
        "print('/jax/compilation_cache/cache_misses' in hits, obs.tolist())"
    )
    first, second = (
        subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | variables,
            capture_output=True,
            text=True,
            check=True,
        )
        for _ in range(2)
    )
    assert first.stdout.split(" ", 1)[0] == "True"
    assert second.stdout.split(" ", 1)[0] == "False"
    assert first.stdout.split(" ", 1)[1] == second.stdout.split(" ", 1)[1]
