"""What a checkpoint says of itself in a few words of JSON, and the digests that tell of damage."""

import dataclasses
import functools
import hashlib
import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError

SCHEMA = 1  # of a checkpoint; raised where an older package would misread it


Result = TypeVar("Result")


class DamagedError(Exception):
    """A checkpoint is not what was saved."""


def noticing_damage(read: Callable[..., Result]) -> Callable[..., Result]:
    """Return a reader that raises DamagedError for any error that a torn file leads to."""

    @functools.wraps(read)
    def reading(*arguments: Any) -> Result:
        try:
            return read(*arguments)
        except (UsageError, DamagedError):
            raise
        except Exception as error:  # JSON, Orbax, TensorStore and msgpack have many kinds
            raise DamagedError(type(error).__name__) from error

    return reading


@dataclasses.dataclass(frozen=True)
class Words:
    """What stands beside a checkpoint's arrays."""

    task: int  # the place of the task that was learned last, from 0
    iteration: int
    recent_return: float | None
    spec: Spec  # of that task
    digests: dict[str, str]  # item of the checkpoint -> its arrays' digest

    def to_dict(self) -> dict[str, Any]:
        """Return the words for JSON, their own digest among them."""
        words = {"schema": SCHEMA} | vars(self) | {"spec": self.spec.to_dict()}
        return words | {"digest": digest_of_words(words)}

    @classmethod
    def read(cls, path: Path, iteration: int) -> "Words":
        """Read the words of the checkpoint of an iteration.

        Raises:
          UsageError: a newer version of the package wrote them.
          Exception: of many kinds: they are not those that were saved.
        """
        words = json.loads(path.read_bytes())
        if words["schema"] > SCHEMA:
            raise UsageError(
                f"'{path}' was written by a newer hitmdp_jax (schema {words['schema']}; "
                f"this one reads up to {SCHEMA}): upgrade to read it."
            )
        if words.pop("digest", None) != digest_of_words(words) or words["iteration"] != iteration:
            raise DamagedError("its words are not those that were saved")
        del words["schema"]
        return cls(**words | {"spec": Spec.from_dict(words["spec"])})

    @property
    def rank(self) -> tuple[float, int]:
        """What the best checkpoint has most of: its return, and of equal ones it is the newest.

        One whose return is not known is better than none.
        """
        return -math.inf if self.recent_return is None else self.recent_return, self.iteration


def best_of_each_task(known: Iterable[Words]) -> dict[int, int]:
    """Return task -> the iteration of its best checkpoint; returns of two cannot be compared."""
    return {words.task: words.iteration for words in sorted(known, key=lambda words: words.rank)}


def digest(tree: Any) -> str:
    """Return a digest of a tree's arrays: their names, shapes, types and every bit of them."""
    found = hashlib.sha256()
    leaves = {_name(path): x for path, x in jax.tree.leaves_with_path(tree)}
    for name in sorted(leaves):
        array = np.ascontiguousarray(jax.device_get(leaves[name]))
        found.update(f"{name} {array.dtype} {array.shape} ".encode())
        found.update(array.tobytes())
    return found.hexdigest()


def digest_of_words(words: dict[str, Any]) -> str:
    """Return a digest of words and numbers, as JSON has them."""
    return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()


def check_fit(folder: Path, found: Any, wanted: Any) -> None:
    """Check that a checkpoint's arrays have the names and shapes of those that are wanted.

    Raises:
      UsageError: they have not; says which.
    """
    there, here = _by_path(found), _by_path(wanted)
    for path in sorted({*there, *here}):
        if there.get(path) != here.get(path):
            raise UsageError(
                f"The checkpoint in '{folder}' does not fit its config.yaml: {path} is "
                f"{_shown(there.get(path))} in it, and {_shown(here.get(path))} by the settings."
            )


def _by_path(tree: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree.leaves_with_path(tree, is_leaf=lambda x: hasattr(x, "shape"))
    return {_name(path): x.shape if hasattr(x, "shape") else np.shape(x) for path, x in leaves}


def _name(path: tuple[Any, ...]) -> str:
    """Return the name of a leaf, whatever holds it: once read, objects are dictionaries."""
    return jax.tree_util.keystr(path, simple=True, separator="/")


def _shown(shape: tuple[int, ...] | None) -> str:
    return "missing" if shape is None else f"an array {list(shape)}"
