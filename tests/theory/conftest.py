import jax
import pytest


@pytest.fixture(autouse=True)
def float64():
    """Run every test of this folder in float64, and leave the setting as it was."""
    with jax.enable_x64(True):
        yield
