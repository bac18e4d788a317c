"""What compiles, or traces, once what tests would otherwise run one operation at a time."""

import functools
from collections.abc import Callable
from typing import Any

import jax

import hitmdp_jax
from hitmdp_jax.agents import AGENTS
from tests.probes import PlaygroundTarget

# For tests that train for minutes. The flags in tests/conftest.py compile fast and run slowly;
# `jax.jit(f, compiler_options=OPTIMIZED)` takes them back for one program.
OPTIMIZED: dict[str, Any] = {"xla_backend_optimization_level": 3}
if jax.__version_info__ < (0, 11):
    OPTIMIZED |= {"xla_cpu_use_fusion_emitters": True}


def compiled(function: Callable[..., Any], **how: Any) -> Callable[..., Any]:
    """Return the function compiled, with results in NumPy: what follows then compiles nothing.

    Inside another program its results are traced, as ever.
    """
    program = jax.jit(function, **how)

    @functools.wraps(function)
    def call(*arguments: Any, **keywords: Any) -> Any:
        return jax.tree.map(_in_numpy, program(*arguments, **keywords))

    return call


def _in_numpy(x: Any) -> Any:
    return x if isinstance(x, jax.core.Tracer) else jax.device_get(x)


@functools.cache
def shapes_of_an_iteration(name: str) -> tuple[Any, Any, Any]:
    """Return the shapes of an agent's state before an iteration and after, and of the metrics."""
    init, step = hitmdp_jax.make_train(
        AGENTS[name](), PlaygroundTarget(), num_steps=128, num_envs=8, rollout_length=8
    )
    before = jax.eval_shape(init, jax.random.key(0))
    return before, *jax.eval_shape(step, before)


def types(tree: Any) -> list[tuple[str, Any]]:
    """Return the type of each array of a tree, with its place."""
    return [(jax.tree_util.keystr(path), x.dtype) for path, x in jax.tree.leaves_with_path(tree)]
