"""Visited states in two dimensions: do options cluster in what the policy sees?"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Projection(NamedTuple):
    """The principal components of S points, C of them, by falling variance."""

    points: np.ndarray  # [S, C] coordinates along the components, about the mean
    components: np.ndarray  # [C, O] unit vectors; the largest entry of each is positive
    explained: np.ndarray  # [C] shares of the variance; 0 of points that are all the same


def project(points: ArrayLike, num_components: int = 2) -> Projection:
    """Project points [S, O] onto their principal components.

    Of fewer dimensions than components, the rest are zeros.

    Args:
      points: say, normalised observations.
      num_components: C.
    """
    points = np.asarray(points, float)
    centred = points - points.mean(axis=0)
    _, scale, components = np.linalg.svd(centred, full_matrices=False)
    missing = max(0, num_components - len(scale))
    scale = np.pad(scale, (0, missing))[:num_components]
    components = np.pad(components, ((0, missing), (0, 0)))[:num_components]
    largest = np.take_along_axis(components, np.abs(components).argmax(1)[:, None], axis=1)
    components = np.where(largest < 0, -components, components)
    total = np.square(centred).sum()
    explained = np.square(scale) / total if total > 0 else np.zeros(num_components)
    return Projection(centred @ components.T, components, explained)
