"""A policy as a program of its own, in ONNX or StableHLO, and the contract of its use."""

import functools
import importlib.metadata
import importlib.util
import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.export
import jax.extend.core
import jax.numpy as jnp
import mujoco
import numpy as np
from brax.envs.base import Env
from jax.interpreters.partial_eval import dce_jaxpr

from hitmdp_jax.envs.base import has_model
from hitmdp_jax.errors import UsageError, missing_extra, unknown_name
from hitmdp_jax.training.policy import Policy

FORMATS = ("onnx", "stablehlo")
PLATFORMS = ("cpu", "cuda")  # of a StableHLO program
BATCH = "batch"  # the first axis of whatever goes in and comes out; of any length
SCHEMA = 1  # of the contract


class Program(NamedTuple):
    """The deterministic policy as a function of a key and arrays, each with a batch axis in front.

    It draws nothing: the key is there because every policy takes one.
    """

    function: Callable[..., tuple[jax.Array, ...]]
    inputs: dict[str, jax.ShapeDtypeStruct]  # by name, in order, without the batch axis
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


def export(policy: Policy, env: Env | None, name: str) -> tuple[bytes, dict[str, Any]]:
    """Export the deterministic policy: the likeliest option, and its likeliest action.

    Args:
      policy: what is exported.
      env: its task; None if that is not known.
      name: "onnx", or "stablehlo": what `jax.export.deserialize` reads.

    Returns:
      The file's content, and its contract, ready to be written as JSON.

    Raises:
      UsageError: the format is unknown, or its extra is missing.
    """
    check_format(name)
    program = program_of(policy, action_range(env))
    content, versions = {"onnx": to_onnx, "stablehlo": to_stablehlo}[name](program)
    return content, {
        "schema": SCHEMA,
        "format": name,
        **contract(program, policy, env),
        "versions": {"hitmdp_jax": importlib.metadata.version("hitmdp-jax")} | versions,
    }


def program_of(policy: Policy, limits: np.ndarray | None) -> Program:
    """Return the program of a policy.

    It maps observations, as the task gives them, and what the policy remembers to actions, to what
    it remembers next and, where it has options, to the options taken.

    Args:
      policy: what is exported.
      limits: the range [2, A] that actions are clipped to; None leaves them as they are.
    """
    key = jax.random.key(0)
    leaves, structure = jax.tree.flatten_with_path(policy.initial_memory(key))
    obs = jax.ShapeDtypeStruct(policy.normalizer.mean.shape, jnp.float32)
    names = [_name(path) for path, _ in leaves]
    remembered = [jax.ShapeDtypeStruct(x.shape, x.dtype) for _, x in leaves]

    def step(key: jax.Array, obs: jax.Array, *remembered: jax.Array) -> dict[str, jax.Array]:
        memory = jax.tree.unflatten(structure, remembered)
        agent, seen = policy.agent, policy.normalized(obs)
        action, memory, noted = agent.act(policy.params, seen, memory, key, deterministic=True)
        if limits is not None:
            action = jnp.clip(action, *limits)
        option = agent.option_of(noted)
        following = {f"next_{n}": x for n, x in zip(names, jax.tree.leaves(memory), strict=True)}
        if option is None:
            return {"action": action} | following
        # A sum: ONNX would have one name for an option that is remembered as it is.
        return {"action": action} | following | {"option": option + 0}

    order: list[str] = []

    def function(key: jax.Array, *arrays: jax.Array) -> tuple[jax.Array, ...]:
        found = step(key, *arrays)
        order[:] = found  # JAX would sort a dictionary's names
        return tuple(found.values())

    shapes = jax.eval_shape(function, key, obs, *remembered)
    inputs = {"obs": obs} | dict(zip(names, remembered, strict=True))
    return Program(function, inputs, dict(zip(order, shapes, strict=True)))


def to_stablehlo(program: Program) -> tuple[bytes, dict[str, str]]:
    """Return a program as `jax.export.deserialize` reads it, and the versions it was made by."""
    function = functools.partial(program.function, jax.random.key(0))
    exported = jax.export.export(jax.jit(function), platforms=PLATFORMS)(*batches(program))
    return bytes(exported.serialize()), {"jax": jax.__version__}


def to_onnx(program: Program) -> tuple[bytes, dict[str, str]]:
    """Return a program in ONNX, and the versions it was made by.

    Raises:
      UsageError: it holds an operation that jax2onnx does not know.
    """
    # Importing it warns of its plugins for libraries that are not used here.
    logging.getLogger("jax2onnx").setLevel(logging.ERROR)
    import jax2onnx

    # Traced here: while jax2onnx traces it puts operations of its own in the place of Flax's and
    # NumPy's, which cannot be vmapped as some networks are. What nothing follows from is left out,
    # and the key, of which ONNX knows nothing, with it.
    shapes = batches(program)
    traced = jax.make_jaxpr(program.function)(jax.random.key(0), *shapes)
    needed = [False] + [True] * len(shapes)
    pruned, _ = dce_jaxpr(traced.jaxpr, [True] * len(program.outputs), instantiate=needed)
    function = jax.extend.core.jaxpr_as_fun(jax.extend.core.ClosedJaxpr(pruned, traced.consts))
    try:
        model = jax2onnx.to_onnx(
            function,
            shapes,
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


def batches(program: Program) -> list[jax.ShapeDtypeStruct]:
    """Return the shapes and types of batches of any length."""
    (batch,) = jax.export.symbolic_shape(BATCH)
    return [jax.ShapeDtypeStruct((batch, *x.shape), x.dtype) for x in program.inputs.values()]


def contract(program: Program, policy: Policy, env: Env | None) -> dict[str, Any]:
    """Return what a caller of a program must know.

    Of what the policy remembers it says what an episode starts with: `initial` is that value, or
    one example where an episode draws it at random.
    """
    limits = action_range(env)
    draws = jax.vmap(policy.initial_memory)(jax.random.split(jax.random.key(0), 64))
    initial = {
        _name(path): {"initial": x[0].tolist(), "drawn": bool((x != x[0]).any())}
        for path, x in jax.tree.leaves_with_path(draws)
    }
    actuators = None
    if has_model(env):
        model = env.model
        actuators = [model.actuator(i).name or f"actuator {i}" for i in range(model.nu)]
    return {
        "inputs": [_described(n, x) | initial.get(n, {}) for n, x in program.inputs.items()],
        "outputs": [_described(n, x) for n, x in program.outputs.items()],
        "deterministic": True,
        "observation_names": observation_names(env),
        "action_names": actuators,
        "action_range": None if limits is None else limits.tolist(),
        "actions_clipped": limits is not None,
        "control_step_seconds": getattr(env, "dt", None),
        "option_count": getattr(policy.agent, "num_options", None),
    }


def action_range(env: Env | None) -> np.ndarray | None:
    """Return the range [2, A] of a task's actions; None if it has none, or none is known."""
    if not has_model(env) or not env.model.actuator_ctrllimited.all():
        return None
    return env.model.actuator_ctrlrange.T.astype(np.float32)


def observation_names(env: Env | None) -> list[str | None] | None:
    """Return which coordinate each number of a task's observation is; None for whatever else.

    Tasks do not say so: it is read off what is observed of random coordinates.
    """
    if not has_model(env):
        return None
    model = env.model
    names = _coordinates(model, "position", model.jnt_qposadr, model.nq)
    names += _coordinates(model, "velocity", model.jnt_dofadr, model.nv)
    size = (2, len(names))  # twice, lest two numbers be equal by chance
    coordinates = jax.random.uniform(jax.random.key(0), size, minval=0.01, maxval=0.1)
    coordinates = coordinates.at[:, : model.nq].add(model.qpos0)
    observe = jax.vmap(lambda x: env.reset_to(x[: model.nq], x[model.nq :]).obs)
    seen = jnp.asarray(observe(coordinates))
    same = (seen[:, :, None] == coordinates[:, None]).all(axis=0)  # [O, nq + nv]
    return [names[int(row.argmax())] if row.any() else None for row in np.asarray(same)]


def _coordinates(model: mujoco.MjModel, kind: str, first: np.ndarray, number: int) -> list[str]:
    """Return each coordinate's name: its joint's, and a number where a joint has several."""
    names = []
    for joint, size in enumerate(np.diff(first, append=number)):
        name = f"{model.joint(joint).name or f'joint {joint}'} {kind}"
        names += [name] if size == 1 else [f"{name} {i}" for i in range(size)]
    return names


def _described(name: str, x: jax.ShapeDtypeStruct) -> dict[str, Any]:
    return {"name": name, "shape": [BATCH, *x.shape], "dtype": x.dtype.name}


def _name(path: tuple[Any, ...]) -> str:
    """Return what a part of the memory is called."""
    return "_".join(["memory", *(jax.tree_util.keystr((k,), simple=True) for k in path)])
