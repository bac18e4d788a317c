"""No test needs an accelerator: the benchmark runs small on a CPU, and programs lower for CUDA."""

import sys

import jax
import pytest

from benchmarks import gpu
from hitmdp_jax.agents import AGENTS
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.run import Run

SMALL = "--env invertedpendulum --envs 4 --seeds 1 2 --algos ppo --num-envs 4 --rollout-length 8"
SMALL += " --minibatch-size 16 --seconds 0.1"


def table(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["gpu", *arguments])
    gpu.main()
    return capsys.readouterr().out.splitlines()


def test_the_table_has_a_row_for_every_figure(monkeypatch, capsys):
    """Environments, one and several seeds, Brax and the seed that is run twice."""
    asked = []

    def figures(row, seconds, cache):
        asked.append(row)
        if row[0] == "learned":
            return {"learned": len(asked), "device": "a card"}  # different each time
        return {"steps_per_second": 1234.5, "first_update_s": 1.0, "device": "a card"}

    monkeypatch.setattr(gpu, "in_own_process", figures)
    monkeypatch.setattr(gpu.importlib.util, "find_spec", lambda name: None)
    lines = table(monkeypatch, capsys, *SMALL.split())
    assert [row[0] for row in asked[::2]] == [
        "env_steps", "training", "training", "brax_ppo", "brax_ppo", "learned"
    ]  # fmt: skip
    assert asked[::2] == asked[1::2]  # cold, then warm
    assert lines[2] == "| mjx, 4 environments, physics alone | 1,234 | 1 / 1 | a card |"
    assert "NOT equal" in lines[-1]


def test_what_the_docs_lack_is_measured_once(monkeypatch, capsys):
    asked = []

    def figures(row, seconds, cache):
        asked.append(row)
        return {"steps_per_second": 1234.5, "first_update_s": 1.0, "device": "a card"}

    monkeypatch.setattr(gpu, "in_own_process", figures)
    lines = table(monkeypatch, capsys, "--lacking", "--seeds", "16", "--physics", "mjx", "warp")
    assert len(asked) == len(lines) - 2 == 12
    assert [row[:3] for row in asked[2:8]] == [
        ["env_steps", "ant", "mjx"], ["training", "ant", "ppo"],
        ["env_steps", "ant", "warp"], ["training", "ant", "ppo"],
        ["training", "halfcheetah", "sac"], ["training", "halfcheetah", "hit_sac"],
    ]  # fmt: skip
    assert "| sac on mjx, preset=off_policy_gpu, 16 seeds | 1,234 | 1 | a card |" in lines


@pytest.mark.slow  # eighteen processes, most of which compile MJX
@pytest.mark.timeout(1800)
def test_everything_is_measured_on_a_cpu(monkeypatch, capsys):
    lines = table(monkeypatch, capsys, *SMALL.split())
    assert len(lines) == 2 + 9
    assert not [line for line in lines if "failed" in line or "NOT equal" in line]


@pytest.mark.parametrize(
    "algo",
    [
        pytest.param(name, marks=pytest.mark.whole if name == "mopg" else pytest.mark.slow)
        for name in AGENTS
    ],
)
def test_a_training_on_mjx_lowers_for_cuda(algo):
    """Nothing in it is for CPUs alone. Whether a GPU then runs it, only a GPU can tell."""
    settings = {"algo": {"name": algo}, "env": {"name": "invertedpendulum"}, "physics": "mjx"}
    run = Run.create(RunConfig.from_mapping(settings))
    init, step = run.program(0)
    steps = jax.jit(lambda states: jax.lax.map(step, states))
    # With the replay of those that have one, which `abstract_state` leaves out, as checkpoints do.
    states = jax.eval_shape(lambda: jax.vmap(init)(run.keys(), run.hyperparameters()))
    lowered = steps.trace(states).lower(lowering_platforms=("cuda",))
    assert "cusolver" in lowered.as_text()  # the solver's factorisations, in CUDA's library
