"""What the package's names mean, whatever else of it was imported."""

import importlib
import importlib.util
import pkgutil

import pytest

import hitmdp_jax

PACKAGES = [
    "hitmdp_jax",
    *(m.name for m in pkgutil.walk_packages(hitmdp_jax.__path__, "hitmdp_jax.") if m.ispkg),
]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_public_name_means_the_same_before_and_after_a_module_of_that_name_is_imported(package):
    module = importlib.import_module(package)
    for name in getattr(module, "__all__", ()):
        before = getattr(module, name)
        if importlib.util.find_spec(f"{package}.{name}"):
            importlib.import_module(f"{package}.{name}")
        assert getattr(module, name) is before, name
