"""Weights & Biases in offline mode: what it would send lies in the run's folder."""

import numpy as np
import pytest
import wandb

from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.sinks import wandb as wandb_sink

METRICS = {
    "a_metric": np.array([1.0, np.nan]),
    "option_steps": np.array([[1.0, 2.0], [3.0, 4.0]]),
    "option_activations": np.array([[1.0, 1.0], [1.0, 1.0]]),
}


SWEEP = {"algo.gamma": [0.9, 0.99]}
NAMES = {  # what is logged: mode, sweep -> name, whether it holds `a_metric`
    ("program", False): {b"now": True},
    ("seed", False): {b"now-seed0": True, b"now-seed1": False},
    ("program", True): {b"now-setting0": True, b"now-setting1": False},
}


@pytest.mark.parametrize(("mode", "swept"), NAMES)
def test_metrics_are_logged_at_environment_steps(tmp_path, monkeypatch, mode, swept):
    monkeypatch.setenv("WANDB_MODE", "offline")
    run_dir = tmp_path / "halfcheetah" / "ppo" / "now"
    run_dir.mkdir(parents=True)
    config = RunConfig(
        algo={"name": "ppo"},
        env={"name": "halfcheetah"},
        seeds=1 if swept else 2,
        sweep=SWEEP if swept else None,
        wandb=mode,
    )
    sink = wandb_sink.open_sink(config, run_dir, 0)
    sink.write(1, 2048, METRICS)
    sink.close()
    wandb.teardown()  # waits until its background process has written everything
    files = {path: path.read_bytes() for path in (run_dir / "wandb").rglob("*.wandb")}
    names = NAMES[mode, swept]
    assert len(files) == len(names)
    for name, known in names.items():
        (logged,) = [data for data in files.values() if name in data]
        assert b"options/share_1" in logged
        # NaN: the second training had no `a`, and a mean over seeds is the first one's.
        assert (b"a_metric" in logged) == known
