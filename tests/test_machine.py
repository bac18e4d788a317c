import os

import pytest

from hitmdp_jax import machine
from hitmdp_jax.machine import available_cores, made_with, note_versions


def test_cores_are_those_the_process_may_run_on(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {1, 5, 6}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert available_cores() == 3


@pytest.mark.parametrize(("counted", "expected"), [(6, 6), (None, 1)])
def test_a_system_without_affinities_offers_all_it_counts(monkeypatch, counted, expected):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: counted)
    assert available_cores() == expected


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
