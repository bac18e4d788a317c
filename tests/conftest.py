import gc
import os

import hypothesis
import jax
import pytest

# Two devices, as `train.py` presents two cores, so that sharding is tested on any machine; and
# threads enough for the large batches of MJX that are tested, as `set_up_host` explains.
jax.config.update("jax_num_cpu_devices", 2)
os.environ.setdefault("NPROC", "8")
# A test runs its programs once or twice: compiling them is what takes time. Without these, LLVM's
# optimisation and MLIR's fusions triple it; what shortens loops and what splits a program among
# threads add a tenth. XLA ends the process at a flag it does not know, and since jaxlib 0.11 it
# does not know the last one.
FAST_TO_COMPILE = [
    "--xla_backend_optimization_level=0",
    "--xla_disable_hlo_passes=simplify-while-loops,while-loop-invariant-code-motion",
]
if jax.__version_info__ < (0, 11):
    FAST_TO_COMPILE += ["--xla_cpu_parallel_codegen_split_count=1"]
    FAST_TO_COMPILE += ["--xla_cpu_use_fusion_emitters=false"]
os.environ["XLA_FLAGS"] = " ".join([*FAST_TO_COMPILE, os.environ.get("XLA_FLAGS", "")])

# No test depends on how fast the machine is (tests/test_pace.py).
hypothesis.settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("any machine")


# Tracing makes objects by the million, and few of them in cycles: look for these more seldom, and
# not among what was imported.
gc.set_threshold(100_000, 10, 10)


def pytest_collection_finish():
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def compilation_cache(tmp_path_factory):
    """Compile each program once a machine, where the developer keeps a cache, or once a session.

    The processes among which pytest-xdist divides the tests share it.
    """
    if not jax.config.jax_compilation_cache_dir:
        folder = tmp_path_factory.getbasetemp()
        if "PYTEST_XDIST_WORKER" in os.environ:
            folder = folder.parent
        folder = folder / "jax_cache"
        jax.config.update("jax_compilation_cache_dir", str(folder))
        # Of a program that takes less, the compiling costs no more than the writing.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


@pytest.fixture(scope="session", autouse=True)
def own_files(tmp_path_factory):
    """Remember the files that tests name in a place of their own, not in the user's home."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def key():
    return jax.random.key(0)
