"""The flags of the commands that work with trained runs: what each is called and what it means.

Only this is imported to answer `--help` and a mistake on the command line.
"""

import argparse
import inspect
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from hitmdp_jax.errors import UsageError, unknown_name
from hitmdp_jax.figures.registry import summaries
from hitmdp_jax.runs.folder import require_run

LATEST = "latest"  # for a RUN_DIR: the newest run under runs/


class Parser(argparse.ArgumentParser):
    """A parser of flags that says what is wrong as all commands do."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError, of which `guarded` makes one sentence."""
        kind, _, words = message.partition(": ")
        if kind == "unrecognized arguments" and words.startswith("-"):
            flag = words.split()[0].split("=")[0]
            raise unknown_name("flag", flag, self._option_string_actions)
        raise UsageError(f"{message[0].upper()}{message[1:]}; --help lists the valid words.")


def parsed(command: str, words: Sequence[str]) -> argparse.Namespace:
    """Return the parsed arguments of a command; each RUN_DIR is a run's folder.

    `latest` stands for the newest run under runs/, and which one that is is said on stderr.

    Raises:
      UsageError: a word is not one of the command's, or a folder holds no run.
    """
    add = COMMANDS[command]
    parser = Parser(
        prog=f"hitmdp {command}",
        description=inspect.getdoc(add),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser._optionals.title = "flags"  # options are something else here
    add(parser)
    _switch(parser, "--trust", "execute the Python files of tasks and algorithms that a run names")
    arguments = parser.parse_args(words)
    if command == "figure" and arguments.name not in (names := summaries()):
        raise unknown_name("figure", arguments.name, names)
    arguments.run_dirs = [_named(run_dir) for run_dir in arguments.run_dirs]
    return arguments


def _named(run_dir: Path) -> Path:
    """Return the run that a word names; Raises as `parsed`."""
    if str(run_dir) != LATEST:
        require_run(run_dir)
        return run_dir
    from hitmdp_jax.runs.claim import newest  # it imports all that reads checkpoints

    run_dir = newest()
    print(f"{LATEST} is {run_dir}", file=sys.stderr)  # what a command prints is its answer alone
    return run_dir


def _evaluate(parser: Parser) -> None:
    """Score the policies of a trained run, print the scores and add them to its evaluations.csv."""
    _run_dirs(parser, 1, "a run's folder")
    _whole(parser, "--seed", "score one of the run's seeds (default: all)")
    _whole(parser, "--setting", "score one of a sweep's settings (default: all)")
    _checkpoint(parser)
    _whole(parser, "--episodes", "episodes of each seed", default=50)
    _engine(parser, "mjx, native, warp or gymnasium")
    _other_task(parser, "score on this task instead")
    _deterministic(parser)
    _switch(parser, "--choices", "also score them with other ways of choosing options")
    _switch(parser, "--json", "print JSON instead of a table")


def _report(parser: Parser) -> None:
    """Write one page about a run, or one that compares several.

    The page is one HTML file that needs no network. It has the learning curve of every seed, what
    each option does, whether options matter, what their embeddings mean, and a video.
    """
    _run_dirs(parser, "+", "a run's folder, or several")
    _whole(parser, "--seed", "show this seed's options (default: the median seed's)")
    _whole(parser, "--episodes", "episodes to record", default=8)
    _other_task(parser, "show the options and the video in this task instead")
    _out(parser, "the file (default: RUN_DIR/report.html; of several runs, comparison.html)")


def _video(parser: Parser) -> None:
    """Film a trained run.

    Writes an MP4 of the episodes, one after the other. Beside it, writes a filmstrip of the first
    episode, which shows what the body does under each option.
    """
    _policy(parser)
    _whole(parser, "--episodes", "episodes to film", default=3)
    _other_task(parser, "film in this task instead")
    _out(parser, "an .mp4 file, or a folder (default: RUN_DIR/videos)")
    _engine(parser, "mjx, native or warp")
    _deterministic(parser)
    _switch(
        parser, "--options", "film what each option does by itself, side by side from one state"
    )
    _switch(parser, "--tensorboard", "also write both for TensorBoard, beside the video")


def _export(parser: Parser) -> None:
    """Export a policy.

    Writes a policy, with its observation normaliser, as a program that does not need this package.
    Beside it, writes a contract in JSON: names, shapes and types of the inputs and outputs, the
    range of actions, and the seconds between two actions. The program takes the most likely option
    and action, and gives the probabilities of the others.
    """
    _policy(parser)
    parser.add_argument("--format", default="onnx", help="onnx or stablehlo (default: onnx)")
    _out(parser, "the file (default: RUN_DIR/export/policy_STEPS.FORMAT)")


def _figure(parser: Parser) -> None:
    """Draw one figure, of a trained run or of the theory, and print the path of its file."""
    lines = [f"  {name:<13} {line}" for name, line in summaries().items()]
    parser.epilog = "\n".join(["figures:", *lines])
    parser.add_argument("name", metavar="FIGURE", help="one of the figures below")
    meaning = "a run's folder; several if the figure compares runs; none if it needs no run"
    _run_dirs(parser, "*", meaning)
    _whole(
        parser,
        "--seed",
        "one of the run's seeds (default: its first); without a run, any (0)",
    )
    _whole(parser, "--setting", "one of a sweep's settings (default: the first, 0)")
    _checkpoint(parser)
    _whole(parser, "--episodes", "episodes to record, if the figure shows episodes (default: 8)")
    _other_task(parser, "record episodes of this task instead")
    _out(parser, "the file (default: FIGURE.png, in RUN_DIR/figures if there is a run)")


def _run_dirs(parser: Parser, number: int | str, meaning: str) -> None:
    more = f"{meaning}; {LATEST}: the newest under runs/"
    parser.add_argument("run_dirs", type=Path, nargs=number, metavar="RUN_DIR", help=more)


def _policy(parser: Parser) -> None:
    """Let a command line name one policy of a run, which `policies.load_chosen` reads."""
    _run_dirs(parser, 1, "a run's folder")
    _whole(parser, "--seed", "one of the run's seeds (default: its first)")
    _whole(parser, "--setting", "one of a sweep's settings (default: the first, 0)")
    _checkpoint(parser)


def _checkpoint(parser: Parser) -> None:
    """Let a command line name a checkpoint, which `policies.load_named` reads."""
    meaning = "newest (default), best, or an iteration"
    parser.add_argument("--checkpoint", metavar="WHICH", help=meaning)
    _whole(parser, "--task", "which task of a transfer, 0 or 1 (default: the newest checkpoint's)")


def _other_task(parser: Parser, meaning: str) -> None:
    """Let a command line name another task than the run's, which `policies.on_task` reads."""
    sizes = "its observations and actions must have the same sizes"
    parser.add_argument("--env", metavar="TASK", help=f"{meaning}; {sizes}")


def _deterministic(parser: Parser) -> None:
    _switch(parser, "--deterministic", "take the most likely option and action at every step")


def _engine(parser: Parser, engines: str) -> None:
    meaning = f"the physics engine: {engines} (default: the run's own)"
    parser.add_argument("--engine", help=meaning)


def _switch(parser: Parser, flag: str, meaning: str) -> None:
    parser.add_argument(flag, action="store_true", help=meaning)


def _out(parser: Parser, meaning: str) -> None:
    parser.add_argument("--out", type=Path, metavar="PATH", help=meaning)


def _whole(parser: Parser, flag: str, meaning: str, default: int | None = None) -> None:
    more = "" if default is None else f" (default: {default})"
    parser.add_argument(flag, type=int, metavar="N", default=default, help=f"{meaning}{more}")


COMMANDS: dict[str, Callable[[Parser], Any]] = {
    "evaluate": _evaluate,
    "report": _report,
    "video": _video,
    "export": _export,
    "figure": _figure,
}
