"""The tasks among which `env=` chooses: those of all suites, which need no YAML files."""

import functools
from typing import Any

from hydra.core.config_store import ConfigStore

from hitmdp_jax.envs import suite_names
from hitmdp_jax.envs.keywords import defaults_of
from hitmdp_jax.envs.suites import find_suite

PLAIN = (bool, int, float, str, type(None))


@functools.cache  # Hydra keeps them as long as the process lives
def store_tasks() -> tuple[str, ...]:
    """Give Hydra a configuration of each task: its name and its constructor's defaults.

    Returns:
      the tasks' names.
    """
    store, names = ConfigStore.instance(), suite_names()
    for name in names:
        group, _, choice = f"env/{name}".rpartition("/")
        store.store(group=group, name=choice, node={"name": name} | _keywords(name))
    return names


def _keywords(name: str) -> dict[str, Any]:
    """Return a task's keywords and defaults, of those that can be written down."""
    suite = find_suite(name)
    assert suite is not None
    defaults = defaults_of(suite.constructor(name), {"physics"})
    return {keyword: x for keyword, x in defaults.items() if isinstance(x, (*PLAIN, tuple))}
