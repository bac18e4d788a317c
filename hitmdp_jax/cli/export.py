"""Export a policy, with its contract beside it."""

import argparse
import json
import logging

from hitmdp_jax.cli.policies import check_output, load_chosen, load_config, output
from hitmdp_jax.cli.waiting import working
from hitmdp_jax.export.program import check_format, export
from hitmdp_jax.runs.folder import EXPORT, replaced
from hitmdp_jax.runs.host import set_up_host


def run(arguments: argparse.Namespace) -> None:
    """Do what `hitmdp export` says; Raises UsageError as what it calls."""
    logging.getLogger("onnx_ir").setLevel(logging.ERROR)  # it warns of shapes that it leaves open
    check_format(arguments.format)
    config = load_config(arguments)
    set_up_host(config.physics, 1)
    choice = load_chosen(arguments, config)
    name = f"policy_{choice.name}.{arguments.format}"
    path = output(arguments, EXPORT, name)
    beside = path.with_name(f"{path.name}.json")
    check_output(path, beside)
    with working("exporting the policy"):
        program, contract = export(choice.policy, arguments.format)
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
