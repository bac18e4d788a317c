"""Export a policy: `python -m hitmdp_jax export RUN_DIR --format onnx`.

Writes a policy, with its observation normaliser, as a program that needs nothing of this package,
and beside it a contract in JSON: names, shapes and types of what goes in and comes out, the range
of actions and the seconds between two of them. The program takes the likeliest option and action,
and says how likely the others are.
"""

import json
import logging
from pathlib import Path

from hitmdp_jax.cli.guard import guarded
from hitmdp_jax.cli.policies import add_choice, load_chosen
from hitmdp_jax.cli.settings import Parser, writable
from hitmdp_jax.export.program import FORMATS, check_format, export
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import EXPORT, made, replaced, subfolder
from hitmdp_jax.runs.host import set_up_host


def main() -> None:
    """Run the command line."""
    logging.getLogger("onnx_ir").setLevel(logging.ERROR)  # it warns of shapes that it leaves open
    guarded(_main)


def _main() -> None:
    parser = Parser(prog="python -m hitmdp_jax export", description=__doc__)
    add_choice(parser)
    parser.add_argument("--format", default=FORMATS[0], help=f"{' or '.join(FORMATS)}; onnx")
    parser.add_argument("--out", type=Path, help="the file; RUN_DIR/export/policy_STEPS.FORMAT")
    options = parser.parse_args()
    check_format(options.format)
    config = RunConfig.load(options.run_dir, options.trust)
    set_up_host(config.physics, 1)
    choice = load_chosen(options)
    name = f"policy_{choice.name}.{options.format}"
    path = options.out or subfolder(options.run_dir, EXPORT) / name
    beside = path.with_name(f"{path.name}.json")
    for file in (path, beside):
        writable("--out", file)
    made(path.parent)
    program, contract = export(choice.policy, options.format)
    origin = {
        "task": choice.task if config.tasks else None,
        "algorithm": config.algo["name"],
        **choice.training.columns,
        "env_steps": choice.env_steps,
    }
    with replaced(path) as file, replaced(beside) as contract_file:  # both or neither
        file.write(program)
        contract_file.write(f"{json.dumps(origin | contract, indent=2)}\n".encode())
    print(f"Saved {path}, and {beside.name} beside it.")
