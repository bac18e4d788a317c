import numpy as np

from hitmdp_jax.experiments.used_options import counts, figure

SEEDS = {
    "algo.entropy_weight": np.array([0.2, 0.2, 0.2, 0.01, 0.01]),
    "options_used": np.array([4.0, 4.0, 2.0, 1.0, 2.0]),
}


def test_seeds_are_counted_by_value_and_number_of_options():
    values, found = counts(SEEDS, "algo.entropy_weight", 4)
    np.testing.assert_array_equal(values, [0.01, 0.2])
    np.testing.assert_array_equal(found, [[1, 1, 0, 0], [0, 1, 0, 2]])


def test_each_bar_is_as_high_as_its_count():
    (axes,) = figure(SEEDS, "algo.entropy_weight", 4).axes
    heights = [[bar.get_height() for bar in group] for group in axes.containers]
    assert heights == [[1, 0], [1, 1], [0, 0], [0, 2]]
    assert axes.get_xlabel() == "entropy_weight"
