"""The package as a stranger installs it: from a wheel, without the checkout."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from tests.cli.conftest import QUICK

CHECKOUT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder into which a wheel is installed, as pip builds it of the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    install = ["install", "--no-deps", "--no-build-isolation", "--target", str(folder / "site")]
    subprocess.run([*pip, *install, str(CHECKOUT)], check=True, cwd=folder)
    return folder / "site"


# What a stranger types, one after another in one process: each start would import everything anew.
COMMANDS = """
import contextlib, io, runpy, sys
import hitmdp_jax

site, *settings = sys.argv[1:]

def run(name, *arguments):
    sys.argv = ["hitmdp", name, *arguments]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        runpy.run_module("hitmdp_jax", run_name="__main__")
    return out.getvalue()

assert hitmdp_jax.__file__.startswith(site), hitmdp_jax.__file__
run("train", *settings, "total_steps=2048", "run_dir=a run")
assert "± " not in run("evaluate", "a run", "--episodes", "2", "--json")
hitmdp_jax.load("a run")
assert "table1" in run("experiment", "--help")
assert "report.html" in run("report", "a run")
print("done")
"""


@pytest.mark.timeout(600)
@pytest.mark.whole
def test_a_wheel_trains_evaluates_and_loads_in_an_empty_folder(site, tmp_path):
    assert {p.name for p in site.iterdir()} >= {"hitmdp_jax"}
    assert not (site / "tests").exists()
    cache = str(jax.config.jax_compilation_cache_dir)
    out = subprocess.run(
        [sys.executable, "-c", COMMANDS, str(site), *QUICK],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(site), "JAX_COMPILATION_CACHE_DIR": cache},
        capture_output=True,
        text=True,
    )
    assert out.returncode == 0, out.stderr
    assert out.stdout.endswith("done\n")
