"""Weights & Biases in offline mode: what it would send lies in the run's folder."""

import numpy as np
import pytest

from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.sinks import WandbSink

METRICS = {"a": np.array([1.0, np.nan]), "option_steps": np.array([[1.0, 2.0], [3.0, 4.0]])}


@pytest.mark.parametrize("mode", ["program", "seed"])
def test_metrics_are_logged_at_environment_steps(tmp_path, monkeypatch, mode):
    monkeypatch.setenv("WANDB_MODE", "offline")
    run_dir = tmp_path / "halfcheetah" / "ppo" / "now"
    run_dir.mkdir(parents=True)
    config = RunConfig(algo={"name": "ppo"}, env={"name": "halfcheetah"}, seeds=2, wandb=mode)
    sink = WandbSink(run_dir, config)
    sink.write(1, 2048, METRICS)
    logged = {run.name: dict(run.summary) for run in sink._runs}
    sink.close()
    if mode == "program":
        assert set(logged) == {"now"}
        assert logged["now"]["a"] == 1.0
        assert logged["now"]["option_steps_0"] == 2.0
        assert logged["now"]["_step"] == 2048
    else:
        assert set(logged) == {"now-seed0", "now-seed1"}
        assert logged["now-seed1"]["option_steps_1"] == 4.0
        assert "a" not in logged["now-seed1"]  # NaN: that seed had none
    files = list((run_dir / "wandb").rglob("*.wandb"))
    assert len(files) == len(logged)
    assert all(path.stat().st_size > 500 for path in files)
