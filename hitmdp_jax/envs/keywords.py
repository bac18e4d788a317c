"""What keywords a task's constructor takes, and whether those given are of their kind."""

import inspect
import math
import types
from collections.abc import Callable, Container, Mapping
from typing import Any, Literal, Union, get_args, get_origin

import jax
import numpy as np
from jax.core import Tracer

from hitmdp_jax.checks import in_float32
from hitmdp_jax.errors import UsageError, out_of_domain, unknown_name

GIVEN = ("physics", "version")  # what `make_env` passes itself, where a constructor takes it
NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
WANTED = {  # type -> how a sentence calls its values; other types are not checked
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
    types.NoneType: "null",
    tuple: "a list",
    list: "a list",
}


def parameters_of(constructor: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a constructor that can be given by name.

    Where a class hands keywords on (`**kwargs`), those of the class above that have a default count
    too; those that have none are the class's own to give. If the last one hands keywords on as
    well, its `**kwargs` is among the parameters: any keyword may be given.
    """
    is_class = isinstance(constructor, type)
    chain: list[Callable[..., Any]] = [constructor]
    if is_class:
        chain = [c.__init__ for c in constructor.__mro__[:-1] if "__init__" in vars(c)]
    found: dict[str, inspect.Parameter] = {}
    rest: dict[str, inspect.Parameter] = {}
    for call in chain:
        taken = list(_signature(call).parameters.values())
        for parameter in taken[1:] if is_class else taken:  # all but self
            optional = parameter.default is not parameter.empty
            if parameter.kind in NAMED and (optional or call is chain[0]):
                found.setdefault(parameter.name, parameter)
        rest = {p.name: p for p in taken if p.kind is p.VAR_KEYWORD}
        if not rest:
            break
    return found | rest


def defaults_of(constructor: Callable[..., Any], without: Container[str] = GIVEN) -> dict[str, Any]:
    """Return the defaults that a constructor states itself, by keyword.

    Keywords that it hands on are left out: a class may give them other defaults on their way.
    """
    parameters = inspect.signature(constructor).parameters.values()
    stated = (p for p in parameters if p.default is not p.empty)
    return {p.name: p.default for p in stated if p.name not in without}


def check_keywords(
    task: str, constructor: Callable[..., Any], keywords: Mapping[str, Any], domains: bool = True
) -> None:
    """Check a task's keywords before it is made.

    A keyword must be of the kind that its annotation says or, without one, of its default's. A
    traced value, known to the compiled program alone, is left as it is.

    Args:
      task: the task's name, for the sentence.
      constructor: what will take the keywords.
      keywords: their values.
      domains: whether names mean what they mean in our own tasks: a range has its lower end first,
        the scale of a noise is not negative, and all other numbers are finite.

    Raises:
      UsageError: a keyword is unknown, missing, not of its kind or out of its domain.
    """
    parameters = parameters_of(constructor)
    known = {n: p for n, p in parameters.items() if n not in GIVEN and p.kind in NAMED}
    takes_any = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    for name, value in keywords.items():
        if name in known:
            _check(name, value, _kind(known[name]), domains)
        elif not takes_any:
            raise unknown_name(f"keyword of {task}", name, known)
    for name, parameter in known.items():
        if parameter.default is parameter.empty and name not in keywords:
            raise UsageError(f"{task} needs the keyword '{name}'.")


def _signature(call: Callable[..., Any]) -> inspect.Signature:
    try:
        return inspect.signature(call, eval_str=True)
    except NameError:  # an annotation for type checkers only
        return inspect.signature(call)


def _kind(parameter: inspect.Parameter) -> Any:
    if parameter.annotation is not parameter.empty:
        return parameter.annotation
    return Any if parameter.default in (None, parameter.empty) else type(parameter.default)


def _check(name: str, value: Any, kind: Any, domains: bool) -> None:
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value)):
        return
    if isinstance(value, np.ndarray | jax.Array) and value.ndim == 0:
        value = value.item()
    fits, wanted = _fits(value, kind), _words(kind)
    if domains and name.endswith("_range"):
        fits = _fits(value, tuple[float, float]) and value[0] <= value[1]
        wanted = "two numbers, the lower first"
    elif domains and name.endswith("noise_scale"):
        fits, wanted = fits and 0 <= value < math.inf, "a finite number from 0"
    elif domains and float in (kind, *get_args(kind)):
        number = isinstance(value, int | float | np.number)
        fits = fits and not (number and math.isinf(in_float32(value)))
        wanted = wanted.replace("a number", "a finite number")
    if not fits:
        raise out_of_domain(name, value, wanted)


def _fits(value: Any, kind: Any) -> bool:
    outer, inner = get_origin(kind) or kind, get_args(kind)
    if outer in (types.UnionType, Union):
        return any(_fits(value, one) for one in inner)
    if outer is Literal:
        return value in inner
    if outer in (tuple, list):
        if not isinstance(value, tuple | list):
            return False
        if outer is list or Ellipsis in inner:
            inner = inner[:1] * len(value)
        return not inner or (len(value) == len(inner) and all(map(_fits, value, inner)))
    if kind is float:
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        return number and value == value  # NaN is, as its name says, not a number
    if kind is int:
        return isinstance(value, int | np.integer) and not isinstance(value, bool)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    return isinstance(value, kind) if kind in WANTED else True


def _words(kind: Any) -> str:
    outer, inner = get_origin(kind) or kind, get_args(kind)
    if outer in (types.UnionType, Union):
        return " or ".join(map(_words, inner))
    if outer is Literal:
        return " or ".join(map(str, inner))
    if outer is tuple and inner and Ellipsis not in inner:
        return f"a list of {', '.join(map(_words, inner))}"
    return WANTED.get(outer, "anything")
