"""A policy as a program of its own, in ONNX or StableHLO, and the contract of its use."""

import importlib.metadata
import importlib.util
import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.export
import jax.numpy as jnp
from jax.extend import core
from jax.interpreters.partial_eval import dce_jaxpr

from hitmdp_jax.envs.spec import Discrete
from hitmdp_jax.errors import UsageError, missing_extra, unknown_name
from hitmdp_jax.networks.action_heads import noise_of, vector_of
from hitmdp_jax.training.policy import Policy

FORMATS = ("onnx", "stablehlo")
PLATFORMS = ("cpu", "cuda")  # of a StableHLO program
BATCH = "batch"  # the first axis of whatever goes in and comes out; of any length
SCHEMA = 2  # of the contract


class Program(NamedTuple):
    """A policy as a function of arrays, each with a batch axis in front."""

    function: Callable[..., list[jax.Array]]
    inputs: dict[str, jax.ShapeDtypeStruct]  # by name, in order
    outputs: dict[str, jax.ShapeDtypeStruct]


def check_format(name: str) -> None:
    """Check that a format is known and can be written.

    Raises:
      UsageError: it is not, or cannot.
    """
    if name not in FORMATS:
        raise unknown_name("format", name, FORMATS)
    if name == "onnx" and importlib.util.find_spec("jax2onnx") is None:
        raise missing_extra("onnx", "format onnx")


def export(policy: Policy, name: str) -> tuple[bytes, dict[str, Any]]:
    """Export a policy, which takes the likeliest option and action and says what it thinks of them.

    Args:
      policy: what is exported.
      name: "onnx", or "stablehlo": what `jax.export.deserialize` reads.

    Returns:
      The file's content, and its contract, ready to be written as JSON.

    Raises:
      UsageError: the format is unknown, its extra is missing, or the policy does not fit it.
    """
    check_format(name)
    with jax.enable_x64(False):  # under x64, jax2onnx would mix numbers of 32 and of 64 bits
        program = program_of(policy)
        content, versions = {"onnx": to_onnx, "stablehlo": to_stablehlo}[name](program)
        return content, {
            "schema": SCHEMA,
            "format": name,
            **contract(program, policy),
            "versions": {"hitmdp_jax": importlib.metadata.version("hitmdp-jax")} | versions,
        }


def program_of(policy: Policy) -> Program:
    """Return the program of a policy.

    It maps observations, as the task gives them, and what the policy remembers to the likeliest
    actions and what is remembered next. What it knows of the alternatives comes out, too: the
    standard deviation of Gaussian actions, or the logits of choices; and where the policy has
    options, the one taken and the logits of all.
    """
    key = jax.random.key(0)
    leaves, structure = jax.tree.flatten_with_path(policy.initial_memory(key))
    obs = jax.ShapeDtypeStruct(policy.spec.observation.shape, jnp.float32)
    (batch,) = jax.export.symbolic_shape(BATCH)  # of any length
    inputs = {
        name: jax.ShapeDtypeStruct((batch, *x.shape), x.dtype)
        for name, x in {"obs": obs, **{_name(path): x for path, x in leaves}}.items()
    }
    order: list[str] = []

    def function(obs: jax.Array, *remembered: jax.Array) -> tuple[jax.Array, ...]:
        found = _decided(policy, obs, jax.tree.unflatten(structure, remembered))
        following = jax.tree.leaves(found.pop("memory"))
        found |= dict(zip((f"next_{name}" for name in list(inputs)[1:]), following, strict=True))
        order[:] = found  # JAX would sort a dictionary's names
        return tuple(found.values())

    # Traced here: while jax2onnx traces it puts operations of its own in the place of Flax's and
    # NumPy's, which cannot be vmapped as some networks are.
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*inputs.values())
    needed, _ = dce_jaxpr(traced.jaxpr, [True] * len(shapes), instantiate=True)  # no keys
    run = core.jaxpr_as_fun(core.ClosedJaxpr(needed, traced.consts))
    return Program(run, inputs, dict(zip(order, shapes, strict=True)))


def _decided(policy: Policy, obs: jax.Array, memory: Any) -> dict[str, Any]:
    """Return the outputs for raw observations [B, ...], and the new memory."""
    agent, params, seen = policy.agent, policy.params, policy.normalized(obs)
    key = jax.random.key(0)  # which nothing is drawn by
    decided = policy.decide(policy.flat(obs), memory, key, True)
    found, option = {"action": decided.action}, decided.option
    chosen = agent.policy(params, seen, option)
    if chosen is not None and isinstance(policy.spec.action, Discrete):
        found["action_logits"] = vector_of(chosen)
    elif chosen is not None:
        found["action_std"] = noise_of(chosen)
    if option is not None:
        # A sum: ONNX would have one name for an option that is remembered as it is.
        found["option"] = option + 0
    probs = agent.option_probs(params, seen, memory)
    if probs is not None:
        found["option_logits"] = jnp.log(probs)
    return found | {"memory": decided.memory}


def to_stablehlo(program: Program) -> tuple[bytes, dict[str, str]]:
    """Return a program as `jax.export.deserialize` reads it, and the versions it was made by."""
    exported = jax.export.export(jax.jit(program.function), platforms=PLATFORMS)
    return bytes(exported(*program.inputs.values()).serialize()), {"jax": jax.__version__}


def to_onnx(program: Program) -> tuple[bytes, dict[str, str]]:
    """Return a program in ONNX, and the versions it was made by.

    Raises:
      UsageError: it holds an operation that jax2onnx does not know.
    """
    # Importing it warns of its plugins for libraries that are not used here.
    logging.getLogger("jax2onnx").setLevel(logging.ERROR)
    import jax2onnx

    try:
        model = jax2onnx.to_onnx(
            program.function,
            list(program.inputs.values()),
            model_name="policy",
            input_names=list(program.inputs),
            output_names=list(program.outputs),
        )
    except Exception as error:  # of as many kinds as there are operations
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise UsageError(
            f"jax2onnx cannot convert this policy ({reason[0]}); format stablehlo can."
        ) from error
    return model.SerializeToString(), {
        "jax2onnx": importlib.metadata.version("jax2onnx"),
        "opset": str(model.opset_import[0].version),
    }


def contract(program: Program, policy: Policy) -> dict[str, Any]:
    """Return the contract of a program: what its caller must know.

    Of what the policy remembers it says what an episode starts with: `initial` is that value, or
    one example where an episode draws it at random.
    """
    limits, spec = policy.spec.action.limits, policy.spec
    draws = jax.vmap(policy.initial_memory)(jax.random.split(jax.random.key(0), 64))
    initial = {
        _name(path): {"initial": x[0].tolist(), "drawn": bool((x != x[0]).any())}
        for path, x in jax.tree.leaves_with_path(draws)
    }
    return {
        "inputs": [_described(n, x) | initial.get(n, {}) for n, x in program.inputs.items()],
        "outputs": [_described(n, x) for n, x in program.outputs.items()],
        "observation_names": list(spec.observation.names),
        "observation_parts": [[part, list(shape)] for part, shape in spec.observation.parts],
        "action_names": list(spec.action.names),
        "action_range": None if limits is None else limits.tolist(),
        "actions_clipped": limits is not None,
        "control_step_seconds": spec.dt,
        "option_count": getattr(policy.agent, "num_options", None),
    }


def _described(name: str, x: jax.ShapeDtypeStruct) -> dict[str, Any]:
    return {"name": name, "shape": [BATCH, *x.shape[1:]], "dtype": x.dtype.name}


def _name(path: tuple[Any, ...]) -> str:
    """Return the name of a part of the memory."""
    return "_".join(["memory", *(jax.tree_util.keystr((k,), simple=True) for k in path)])
