import numpy as np

from hitmdp_jax.networks import read


def test_a_network_reads_the_entries_that_it_is_told_to():
    obs = np.arange(12.0).reshape(2, 6)
    np.testing.assert_array_equal(read(obs, (0, 4, 5)), [[0, 4, 5], [6, 10, 11]])
    assert read(obs, None) is obs
