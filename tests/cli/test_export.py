"""`python -m hitmdp_jax export` as a user runs it."""

import json

import jax.export
import numpy as np


def test_a_policy_is_written_with_its_contract_beside_it(command, finished, tmp_path):
    run_dir, _ = finished
    out = tmp_path / "a" / "policy.bin"
    result = command("export", run_dir, "--format", "stablehlo", "--seed", "4", "--out", out)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"Saved {out}, and policy.bin.json beside it.\n"
    contract = json.loads((tmp_path / "a" / "policy.bin.json").read_text())
    assert contract["task"]["name"] == "invertedpendulum"
    about = {"algorithm": "mopg", "seed": 4, "env_steps": 8192, "format": "stablehlo"}
    assert {name: contract[name] for name in about} == about
    program = jax.export.deserialize(bytearray(out.read_bytes()))
    action, *_ = program.call(np.zeros((3, 4), np.float32), np.zeros(3, np.int32))
    assert action.shape == (3, 1)
