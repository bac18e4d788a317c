import numpy as np

from hitmdp_jax.interpret.projection import project


def test_components_are_eigenvectors_of_the_covariance():
    points = np.random.default_rng(0).normal(size=(50, 4)) * [3.0, 1.0, 2.0, 0.5] + 7.0
    values, vectors = np.linalg.eigh(np.cov(points.T))
    found = project(points)
    np.testing.assert_allclose(found.explained, values[::-1][:2] / values.sum())
    for mine, vector in zip(found.components, vectors.T[::-1][:2], strict=True):
        assert abs(mine @ vector) > 1 - 1e-9
        assert mine[np.abs(mine).argmax()] > 0
    expected = (points - points.mean(axis=0)) @ found.components.T
    np.testing.assert_allclose(found.points, expected, atol=1e-9)


def test_a_line_has_one_component():
    found = project(np.outer(np.arange(5.0), [3.0, -4.0]))
    np.testing.assert_allclose(found.explained, [1, 0], atol=1e-12)
    np.testing.assert_allclose(found.components[0], [-0.6, 0.8])


def test_fewer_dimensions_than_components_and_no_variance():
    single = project(np.arange(3.0)[:, None])
    np.testing.assert_allclose(single.points, [[-1, 0], [0, 0], [1, 0]], atol=1e-12)
    still = project(np.ones((4, 3)))
    np.testing.assert_array_equal(still.points, np.zeros((4, 2)))
    np.testing.assert_array_equal(still.explained, [0, 0])
