"""The one exception that a user's mistake raises."""

import difflib
import re
import sys
from collections.abc import Iterable
from typing import NoReturn

SHOWN = 12  # names in one sentence, at most
ALIKE = 0.6  # from 0 to 1, of a name that is worth proposing
ELSEWHERE = {  # what other packages call it -> what it is called here
    "discount": "gamma",
    "ent_coef": "entropy_weight",
    "entropy_cost": "entropy_weight",
    "n_steps": "rollout_length",
    "unroll_length": "rollout_length",
    "layers": "hidden_sizes",
    "frame_skip": "action_repeat",
}


class UsageError(ValueError):
    """Bad input, explained in one sentence: what was wrong and which values are valid.

    The command line prints the sentence alone and exits with code 2. Whatever names a file or a
    stranger chose, a terminal takes none of it for a command.
    """

    def __init__(self, sentence: object):
        super().__init__(printable(str(sentence)))


def printable(text: str) -> str:
    """Return text in one line, its control characters spelled out as Python spells them."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def warn(sentence: object) -> None:
    """Tell of what goes wrong and ends nothing, in one line."""
    print(f"warning: {printable(str(sentence))}", file=sys.stderr)


def exit_with(error: UsageError) -> NoReturn:
    """End a command with the error's sentence and exit code 2."""
    print(f"error: {error}", file=sys.stderr)
    sys.exit(2)


def unknown_name(kind: str, name: str, valid: Iterable[str], listed: str = "") -> UsageError:
    """Return the error for a name that is not in `valid`, naming the nearest one.

    Args:
      kind: what the name stands for, e.g. "environment".
      name: what the user wrote.
      valid: the names that would have been accepted; of many, the nearest are shown.
      listed: what lists many of them, in place of the sentence.
    """
    options = sorted(set(valid))
    if not options:
        return UsageError(f"Unknown {kind} '{name}': there are none.")
    near = nearest(name, options)
    hint = f"; did you mean '{near}'?" if near else "."
    if len(options) <= SHOWN:
        return UsageError(f"Unknown {kind} '{name}'{hint} Valid: {', '.join(options)}.")
    if listed:
        return UsageError(f"Unknown {kind} '{name}'{hint} {listed} lists all {len(options)}.")
    shown = sorted(options, key=lambda option: -_likeness(name, option))[:SHOWN]
    return UsageError(
        f"Unknown {kind} '{name}'{hint} Valid: {', '.join(shown)} and {len(options) - SHOWN} more."
    )


def nearest(name: str, options: Iterable[str]) -> str | None:
    """Return the option that a mistaken name most likely stands for, if any is like it."""
    likeliest = max(options, key=lambda option: _likeness(name, option), default=None)
    return likeliest if likeliest and _likeness(name, likeliest) >= ALIKE else None


def _likeness(name: str, option: str) -> float:
    """Return how much two names are alike, from 0 to 1, and a little more in the same group.

    Of `algo.learning_rate` or `dmc/cheetah_run` the last part counts: a group in common, such as
    `algo.`, makes no names alike. `lr` is short for `learning_rate`.
    """
    (*group, last), (*other, word) = (re.split("[./]", x.lower()) for x in (name, option))
    last = ELSEWHERE.get(last, last)
    initials = "".join(part[:1] for part in word.split("_")) if "_" in word else None
    alike = difflib.SequenceMatcher(None, last, word).ratio()
    return max(alike, last == initials) + 0.01 * (group == other)


def out_of_domain(name: str, value: object, wanted: str) -> UsageError:
    """Return the error for a value outside its domain, e.g. wanted="a positive whole number"."""
    return UsageError(f"{name} = {value} must be {wanted}.")


def missing_extra(extra: str, needed_for: str) -> UsageError:
    """Return the error for an optional dependency that is not installed."""
    return UsageError(
        f"{needed_for} needs the extra '{extra}': install it with "
        f"pip install 'hitmdp-jax[{extra}]'."
    )
