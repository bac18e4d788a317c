import jax
import numpy as np
import pytest

from hitmdp_jax.learning.schedules import anneal
from tests.programs import compiled


@pytest.mark.parametrize(
    ("schedule", "expected"),
    [
        ("constant", [4.0, 4.0, 4.0, 4.0]),
        ("linear", [4.0, 3.5, 3.0, 2.0]),
        # 2 + 2 (1 + cos(pi progress)) / 2
        ("cosine", [4.0, 3.0 + np.cos(np.pi / 4), 3.0, 2.0]),
    ],
)
def test_values_over_a_run(schedule, expected):
    progress = np.array([0.0, 0.25, 0.5, 1.0])
    values = compiled(jax.vmap(lambda p: anneal(schedule, 4.0, 2.0, p)))(progress)
    np.testing.assert_allclose(values, expected, rtol=1e-6)


def test_the_end_is_kept_beyond_the_run():
    assert float(compiled(anneal, static_argnums=0)("linear", 4.0, 2.0, 1.5)) == 2.0


def test_ends_may_be_swept():
    values = compiled(jax.vmap(lambda a: anneal("linear", a, 0.0, 0.5)))(np.array([1.0, 2.0]))
    np.testing.assert_allclose(values, [0.5, 1.0])
