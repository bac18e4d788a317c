"""A policy in one file: its settings, what its task says of itself, and its parameters.

The file is MessagePack as Flax writes it, of text and arrays alone: reading a stranger's runs no
code. Digests of all that it holds tell damage.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import serialization

from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.reading import parse_yaml, read_bytes, unreadable
from hitmdp_jax.runs.checkpoint_words import digest, digest_of_words
from hitmdp_jax.runs.folder import write

SCHEMA = 1  # raised where an older package would misread the file


class PolicyFile(NamedTuple):
    """What the file holds."""

    settings: Any  # those of a run of that policy alone, as its config.yaml would hold them
    iteration: int  # after which the policy acted so
    learned: dict[str, Any]  # as `checkpoint.policy_of`, [1, ...]
    spec: Spec


def write_policy(
    path: Path, config: str, iteration: int, learned: dict[str, Any], spec: Spec
) -> None:
    """Write a policy; `config` is YAML, the rest as `PolicyFile`; Raises as `folder.replaced`."""
    arrays = serialization.to_state_dict(jax.device_get(learned))
    words = {
        "schema": SCHEMA,
        "config": config,
        "iteration": iteration,
        "spec": spec.to_dict(),
        "arrays": digest(arrays),
    }
    words["digest"] = digest_of_words(words)
    write(path, serialization.msgpack_serialize({"words": json.dumps(words), "arrays": arrays}))


def read_policy(path: Path) -> PolicyFile:
    """Return the content of a policy's file.

    Raises:
      UsageError: it cannot be read, or is not what was written.
    """
    try:
        content = serialization.msgpack_restore(read_bytes(path))
        words, arrays = json.loads(str(content["words"])), content["arrays"]
        if words["schema"] > SCHEMA:
            raise unreadable(path, "a newer hitmdp_jax wrote it")
        known = words.pop("digest")
        if known != digest_of_words(words) or words["arrays"] != digest(arrays):
            raise unreadable(path, "it does not hold what was saved")
        settings, spec = parse_yaml(words["config"], path), Spec.from_dict(words["spec"])
        return PolicyFile(settings, words["iteration"], jax.tree.map(jnp.asarray, arrays), spec)
    except UsageError:
        raise
    except OSError as error:
        raise unreadable(path, error.strerror or type(error).__name__) from None
    except Exception:  # whatever damage makes a reader say
        raise unreadable(path, "it holds no policy") from None
