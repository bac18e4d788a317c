from hitmdp_jax import machine
from hitmdp_jax.runs.provenance import made_with, note_versions


def test_a_run_says_what_trained_each_part_of_it(monkeypatch, tmp_path):
    assert made_with(tmp_path) == "unknown versions"
    note_versions(tmp_path)
    note_versions(tmp_path)
    here = ", ".join(machine.versions())
    assert made_with(tmp_path) == here
    monkeypatch.setattr(machine, "versions", lambda: ["jax 0.11.2", "gpu (NVIDIA H200)"])
    assert made_with(tmp_path) == here  # not what reads it
    note_versions(tmp_path)
    assert made_with(tmp_path) == f"{here}; then jax 0.11.2, gpu (NVIDIA H200)"
