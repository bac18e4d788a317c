import numpy as np

from hitmdp_jax.learning.options import mean_duration, option_statistics


def test_counts_of_a_hand_written_sequence():
    #                 0  0  1  1 | 1  0   an episode starts at index 4
    option = np.array([0, 0, 1, 1, 1, 0])[:, None]
    previous = np.array([2, 0, 0, 1, 1, 1])[:, None]
    started = np.array([1, 0, 0, 0, 1, 0], bool)[:, None]
    counts = option_statistics(option, previous, started, num_options=3)
    np.testing.assert_array_equal(counts["option_steps"], [3, 3, 0])
    # option 0: at the start and at the end; option 1: at its switch and at the new episode.
    np.testing.assert_array_equal(counts["option_activations"], [2, 2, 0])
    assert mean_duration(counts["option_steps"].sum(), counts["option_activations"].sum()) == 1.5


def test_an_option_that_ran_throughout_counts_once():
    assert mean_duration(np.array(2048.0), np.array(0.0)) == 2048


def test_an_option_that_never_ran_has_no_duration():
    assert np.isnan(mean_duration(np.array(0.0), np.array(0.0)))
