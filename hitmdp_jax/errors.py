"""The one exception that a user's mistake raises."""

import difflib
import sys
from collections.abc import Iterable
from typing import NoReturn


class UsageError(ValueError):
    """Bad input, explained in one sentence: what was wrong and which values are valid.

    The command line prints the sentence alone and exits with code 2.
    """


def exit_with(error: UsageError) -> NoReturn:
    """End a command with the error's sentence and exit code 2."""
    print(f"error: {error}", file=sys.stderr)
    sys.exit(2)


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> UsageError:
    """Return the error for a name that is not in `valid`, naming the nearest one.

    Args:
      kind: what the name stands for, e.g. "environment".
      name: what the user wrote.
      valid: the names that would have been accepted.
    """
    options = sorted(valid)
    if not options:
        return UsageError(f"Unknown {kind} '{name}': there are none.")
    by_lower = {option.lower(): option for option in options}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.5)
    hint = f"; did you mean '{by_lower[near[0]]}'?" if near else "."
    return UsageError(f"Unknown {kind} '{name}'{hint} Valid: {', '.join(options)}.")


def out_of_domain(name: str, value: object, wanted: str) -> UsageError:
    """Return the error for a value outside its domain, e.g. wanted="a positive whole number"."""
    return UsageError(f"{name} = {value} must be {wanted}.")


def missing_extra(extra: str, needed_for: str) -> UsageError:
    """Return the error for an optional dependency that is not installed."""
    return UsageError(
        f"{needed_for} needs the extra '{extra}': install it with pip install -e '.[{extra}]'."
    )
