"""Weights & Biases in offline mode: what it would send lies in the run's folder."""

import numpy as np
import pytest
import wandb

from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.sinks import WandbSink

METRICS = {"a_metric": np.array([1.0, np.nan]), "option_steps": np.array([[1.0, 2.0], [3.0, 4.0]])}


@pytest.mark.parametrize("mode", ["program", "seed"])
def test_metrics_are_logged_at_environment_steps(tmp_path, monkeypatch, mode):
    monkeypatch.setenv("WANDB_MODE", "offline")
    run_dir = tmp_path / "halfcheetah" / "ppo" / "now"
    run_dir.mkdir(parents=True)
    config = RunConfig(algo={"name": "ppo"}, env={"name": "halfcheetah"}, seeds=2, wandb=mode)
    sink = WandbSink(run_dir, config)
    sink.write(1, 2048, METRICS)
    sink.close()
    wandb.teardown()  # waits until its background process has written everything
    files = {path: path.read_bytes() for path in (run_dir / "wandb").rglob("*.wandb")}
    names = {b"now"} if mode == "program" else {b"now-seed0", b"now-seed1"}
    assert len(files) == len(names)
    for name in names:
        (logged,) = [data for data in files.values() if name in data]
        assert b"option_steps_1" in logged
        # NaN: the second seed had no `a`, and the mean over seeds is the first one's.
        assert (b"a_metric" in logged) == (name != b"now-seed1")
