"""Warm starts: a training that begins with what another one learned."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.training.policy import Policy
from hitmdp_jax.training.state import TrainState

PARTS = ("policy", "critic", "normalizer", "optimizer")
PARAMS, LEARNER, NORMALIZER = "learner/params/", "learner/", "normalizer/"
NAMED = 6  # arrays that a sentence names


class Learned(NamedTuple):
    """What a training may begin with."""

    leaves: dict[str, jax.Array]  # by their names in a TrainState, such as "normalizer/mean"
    spec: Spec  # of the task that it was learned on


class Fit(NamedTuple):
    """What of it fits a training."""

    taken: dict[str, str]  # name of an array in the training's state -> where it comes from
    anew: list[str]  # what starts anew, in words


def learned_of(source: Any) -> Learned:
    """Return the contents of a policy or of the state of a training.

    Raises:
      UsageError: it is neither.
    """
    if isinstance(source, Policy):
        tree = {"learner": {"params": source.params}, "normalizer": source.normalizer}
    elif isinstance(source, TrainState):
        tree = {"learner": source.learner, "normalizer": source.normalizer}
    else:
        kind = type(source).__name__
        raise UsageError(f"init_from is a {kind}: pass a Policy, as load returns, or a TrainState.")
    return Learned(by_name(tree), source.spec)


def by_name(tree: Any) -> dict[str, Any]:
    """Return a tree's leaves by their names, whatever holds them."""
    return {_name(path): x for path, x in jax.tree.leaves_with_path(tree)}


def check_parts(parts: Any) -> tuple[str, ...]:
    """Return the parts of what was learned that are asked for, None being all.

    Raises:
      UsageError: there is no such part.
    """
    if parts is None:
        return PARTS
    chosen = parts.split(",") if isinstance(parts, str) else parts
    if not isinstance(chosen, Sequence) or not chosen:
        raise UsageError(f"init_parts = {parts!r} must name some of {', '.join(PARTS)}.")
    for part in chosen:
        if part not in PARTS:
            raise unknown_name("part of init_parts", str(part), PARTS)
    return tuple(chosen)


def fit(
    state: TrainState, learned: Learned, shapes: Mapping[str, Any], parts: Sequence[str]
) -> Fit:
    """Return the parts of a source that fit a training.

    Parameters are taken array by array, the normaliser and the optimiser whole or not at all: an
    optimiser that knows some parameters alone would take too large steps along the others.

    Args:
      state: the training's before its first iteration, or its shapes.
      learned: the source.
      shapes: of one training's arrays there, by name.
      parts: of `PARTS`, those that are asked for.

    Raises:
      UsageError: nothing fits.
    """
    wanted = {n: x.shape for n, x in by_name(state).items() if n.startswith((LEARNER, NORMALIZER))}
    fits = {name for name, shape in wanted.items() if shapes.get(name) == shape}
    params = [name for name in wanted if name.startswith(PARAMS)]
    taken = {name: name for name in params if name in fits and part_of(name) in parts}
    missing = [name for name in params if name not in taken]
    anew = _words([n for n in missing if part_of(n) in parts])
    anew += [part for part in ("policy", "critic") if part not in parts]
    useful = any(len(wanted[name]) > 1 for name in taken)  # biases and scales alone are no skill
    for part, names in (
        ("normalizer", [n for n in wanted if n.startswith(NORMALIZER)]),
        ("optimizer", [n for n in wanted if n.startswith(LEARNER) and n not in params]),
    ):
        if part in parts and fits.issuperset(names) and not (part == "optimizer" and missing):
            taken |= {name: name for name in names}
            useful |= part == "normalizer"
        else:
            anew.append(part)
            taken |= {name: of for name, of in _copies(names).items() if of in taken}
    if not useful:
        raise UsageError(
            f"init_from: nothing fits. What it holds observes {learned.spec.observation} and acts "
            f"by {learned.spec.action}; the task has {state.spec.observation} and "
            f"{state.spec.action}, and the networks are {'others' if anew else 'the same'}."
        )
    return Fit(taken, anew)


def _copies(names: Sequence[str]) -> dict[str, str]:
    """Return which parameters those arrays copy that follow them, such as a target network's."""
    others = [name for name in names if not name.startswith(f"{LEARNER}opt_state/")]
    return {name: PARAMS + name.partition("/params/")[2] for name in others}


def part_of(name: str) -> str:
    """Return of which part a parameter is, by its name."""
    return "critic" if "critic" in name.split("/") else "policy"


def begun(state: TrainState, taken: Mapping[str, str], leaves: Mapping[str, Any]) -> TrainState:
    """Return a state with some of its arrays replaced; pure."""

    def replaced(path: Any, x: jax.Array) -> jax.Array:
        name = _name(path)
        return jnp.asarray(leaves[taken[name]], x.dtype) if name in taken else x

    return jax.tree.map_with_path(replaced, state)


def sentence(fit: Fit, old: Spec, new: Spec) -> str:
    """Return which parts start anew in a training that begins with another one's; "" for none."""
    told = []
    if old.observation != new.observation:
        told.append(_change("what it observes", old.observation, new.observation))
    if old.action != new.action:
        told.append(_change("how it acts", old.action, new.action))
    if fit.anew:
        told.append(f"starting anew: {', '.join(fit.anew)}")
    return "; ".join(told)


def _change(what: str, old: Any, new: Any) -> str:
    if str(old) != str(new):
        return f"{what} is new, {new} instead of {old}"
    others = [name for name in new.names if name not in old.names]
    return f"{what} is of the same size, but of another task" + (
        f" ({', '.join(others[:NAMED])}{' ...' if len(others) > NAMED else ''})" if others else ""
    )


def _words(missing: list[str]) -> list[str]:
    """Return the names of arrays, few of them."""
    names = [name.removeprefix(PARAMS) for name in missing]
    more = [f"{len(names) - NAMED} more arrays"] if len(names) > NAMED else []
    return names[:NAMED] + more


def _name(path: tuple[Any, ...]) -> str:
    return jax.tree_util.keystr(path, simple=True, separator="/")
