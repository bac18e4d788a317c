"""A suite comes in by one file and one line: everything else asks the table."""

import sys
import types

import brax.envs
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.cli import tasks
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs import (
    check_engine,
    check_env,
    check_installed,
    engine_for,
    suite_names,
)
from hitmdp_jax.envs.suites import Suite, all_suites
from hitmdp_jax.errors import UsageError
from tests.probes import Counter


class Paced(Counter):
    """A task of another library, with a keyword."""

    def __init__(self, pace: float = 1.0):
        self.pace = pace


@pytest.fixture
def counters(monkeypatch):
    """Return a suite, with its line in the table."""
    suite = Suite(
        prefix="counters/",
        package="no_such_package",
        extra="dmc",
        own_physics=True,
        ours=False,
        folder="tests.envs.suites",
        tasks={"paced": "test_suites:Paced"},
    )
    module = types.ModuleType("hitmdp_jax.envs.suites.counters")
    module.SUITE = suite
    monkeypatch.setitem(sys.modules, module.__name__, module)
    package = sys.modules["hitmdp_jax.envs.suites"]
    monkeypatch.setattr(package, "SUITES", (*package.SUITES, "counters"))
    package.all_suites.cache_clear()
    tasks.store_tasks.cache_clear()
    yield suite
    package.all_suites.cache_clear()
    tasks.store_tasks.cache_clear()


def test_the_whole_package_knows_a_suite_of_the_table(counters, monkeypatch):
    name = "counters/paced"
    assert name in suite_names()
    assert name not in hitmdp_jax.list_envs()  # which lists this package's own
    assert Settings([f"env={name}", "env.pace=2"]).config().env["pace"] == 2
    assert check_env(name) is Paced
    assert engine_for(name, "native") == "mjx"
    for mistake, sentence in (
        (lambda: check_env("counters/pased"), "did you mean 'counters/paced'?"),
        (lambda: check_env(name, paces=1), "did you mean 'pace'?"),
        (lambda: check_env(name, pace="fast"), "pace = fast must be a finite number"),
        (lambda: check_engine(name, "native"), "physics must stay at its default"),
        (lambda: check_installed(name), "A task of counters needs the extra 'dmc'"),
        (lambda: hitmdp_jax.make_env(name), "A task of counters needs the extra 'dmc'"),
        (lambda: hitmdp_jax.register_env(name, Paced), "is a built-in environment"),
    ):
        with pytest.raises(UsageError) as error:
            mistake()
        assert sentence in str(error.value)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    assert hitmdp_jax.make_env(name, pace=np.float32(3)).pace == 3


def test_names_of_suites_do_not_overlap():
    names = suite_names()
    assert len(set(names)) == len(names)
    prefixes = [suite.prefix for suite in all_suites()]
    assert sum(prefix == "" for prefix in prefixes) == 1


def test_the_tasks_of_brax_are_those_that_it_registers():
    """They are written down here, since Brax takes seconds to import."""
    suite = next(suite for suite in all_suites() if suite.prefix == "brax/")
    registered = {f"brax/{name}": task for name, task in brax.envs._envs.items()}
    assert {name: suite.constructor(name) for name in suite.names()} == registered
