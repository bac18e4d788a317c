"""Train an agent: `python train.py env=halfcheetah algo=mopg physics=native seeds=10`.

Every setting is in configs/; `python train.py --help` says what each means.
"""

import sys

from hitmdp_jax.cli import help
from hitmdp_jax.cli.guard import guarded, work_of
from hitmdp_jax.cli.overrides import name_of
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.errors import UsageError, nearest, unknown_name

MULTIRUN, HELP = {"-m", "--multirun"}, {"-h", "--help"}
OF_HYDRA = {"--hydra-help", "--version", "--cfg=job", "--cfg=all", "--info"}
FLAGS = MULTIRUN | HELP | OF_HYDRA


def main() -> None:
    """Run the command line."""
    flags = [word for word in sys.argv[1:] if word.startswith("-")]
    named = [word for word in sys.argv[1:] if not word.startswith("-")]
    guarded(lambda: _main(flags, named), shows=bool(set(flags) - MULTIRUN))


def _main(flags: list[str], named: list[str]) -> int:
    for flag in flags:
        if flag not in FLAGS:
            raise _unknown_flag(flag)
    settings = Settings(named, multirun=bool(MULTIRUN & set(flags)))
    if HELP & set(flags):
        print(help.text(settings))
        return 0
    if flags:
        return work_of("jobs").run(settings, flags)
    names = [name_of(override) for override in settings.overrides]
    return work_of("training").train(settings.values(), names)


def _unknown_flag(flag: str) -> UsageError:
    """Return the error for a flag that there is not; it may be meant for a setting."""
    name, _, value = flag.lstrip("-").partition("=")
    settings = Settings([])
    near = nearest(name, [*settings.groups, *settings.names([])])
    if near and not nearest(flag, FLAGS):
        meant = f"{near}={value or 'VALUE'}"
        return UsageError(f"Unknown flag '{flag}': settings have no dashes, as {meant}.")
    return unknown_name("flag", flag, FLAGS)
