"""`hitmdp COMMAND ...`, and `python -m hitmdp_jax COMMAND ...`: everything that can be done."""

import importlib
import sys

COMMANDS = {
    "train": "train an agent: name=value ...",
    "evaluate": "score a trained run in an engine",
    "report": "write one page about a run, or a comparison of several",
    "video": "film a trained run",
    "export": "write a policy as a program of its own",
    "figure": "draw one figure of a trained run, or of the paper's theorems",
    "experiment": "train arms on tasks and compare them: the paper's tables, a study, your own",
}


def usage() -> str:
    """Return the list of commands, one per line."""
    lines = [f"  {name:<10} {does}" for name, does in COMMANDS.items()]
    return "\n".join(
        ["usage: hitmdp COMMAND ...", "", *lines, "", "hitmdp COMMAND --help explains a command."]
    )


def main() -> None:
    """Run the command that the command line names. Nothing is imported before it is needed."""
    name, *rest = sys.argv[1:] or ["--help"]
    if name in ("-h", "--help"):
        print(usage())
        return
    from hitmdp_jax.errors import exit_with, unknown_name

    if name not in COMMANDS:
        exit_with(unknown_name("command", name, COMMANDS))
    from hitmdp_jax.cli import flags, guard

    if name in flags.COMMANDS:
        guard.guarded(lambda: guard.work(name, flags.parsed(name, rest)))
    else:
        sys.argv = [f"hitmdp {name}", *rest]
        importlib.import_module(f"hitmdp_jax.cli.{name}").main()


if __name__ == "__main__":
    main()
