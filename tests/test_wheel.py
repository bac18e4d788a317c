"""The package as a stranger installs it: from a wheel, without the checkout."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

CHECKOUT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder into which the wheel is installed."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    build = ["wheel", str(CHECKOUT), "--no-deps", "--no-build-isolation", "-w", str(folder)]
    subprocess.run([*pip, *build], check=True, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    subprocess.run([*pip, "install", "--no-deps", "--target", str(target), str(wheel)], check=True)
    return target


@pytest.mark.timeout(600)
def test_a_wheel_trains_evaluates_and_loads_in_an_empty_folder(site, tmp_path):
    assert {p.name for p in site.iterdir()} >= {"hitmdp_jax"}
    assert not (site / "tests").exists()
    cache = str(jax.config.jax_compilation_cache_dir)
    environment = os.environ | {"PYTHONPATH": str(site), "JAX_COMPILATION_CACHE_DIR": cache}

    def run(*arguments):
        out = subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert out.returncode == 0, out.stderr
        return out.stdout

    code = "import hitmdp_jax; print(hitmdp_jax.__file__)"
    assert str(site) in run("-c", code)
    run(
        "-m", "hitmdp_jax.train", "env=invertedpendulum", "algo=ppo", "physics=native",
        "algo.num_epochs=1", "total_steps=2048", "run_dir=a run",
    )  # fmt: skip
    assert "± " not in run("-m", "hitmdp_jax.evaluate", "a run", "--episodes", "2", "--json")
    run("-c", "import hitmdp_jax; hitmdp_jax.load('a run')")
    out = run("-m", "hitmdp_jax.reproduce", "--help")
    assert "theory" in out
