"""A schedule whose numbers can be counted by hand: 20 iterations of 100 steps make a report."""

import pytest

from hitmdp_jax.runs.schedule import Schedule

SHORT = Schedule(total_steps=9_001, steps_per_iteration=100, checkpoint_steps=4_100, num_tasks=2)


def test_a_task_takes_whole_reports():
    assert SHORT.iterations_per_report == 20
    assert SHORT.iterations == 100  # 9,001 steps are more than four reports of 2,000
    assert (SHORT.last_iteration, SHORT.env_steps, SHORT.switch_at) == (200, 20_000, 10_000)


@pytest.mark.parametrize(
    ("every", "first"), [(1, [20, 40, 60]), (2_000, [20, 40, 60]), (5_999, [40, 80, 120])]
)
def test_what_is_done_every_so_often_is_done_after_whole_reports(every, first):
    assert [i for i in range(1, 201) if SHORT.is_due(i, every)][:3] == first


def test_a_run_saves_after_so_many_steps():
    assert [i for i in range(1, 201) if SHORT.saves(i)] == [40, 80, 120, 160, 200]


def test_a_run_without_a_task_that_is_named_has_a_first_one():
    """What was saved from Python: its checkpoints are of some iteration."""
    unnamed = Schedule(9_001, 100, 4_100, num_tasks=0)
    assert (unnamed.task_at(0), unnamed.task_at(500), unnamed.switch_at) == (0, 0, None)
    assert [SHORT.task_at(i) for i in (0, 1, 100, 101, 200, 999)] == [0, 0, 0, 1, 1, 1]
