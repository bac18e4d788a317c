"""What numbers may be."""

import pytest

from hitmdp_jax.checks import divisor_below


@pytest.mark.parametrize("number", [1, 2, 12, 36, 37, 60])
def test_the_nearest_divisor_is_the_largest_that_is_not_above(number):
    for most in range(1, number + 3):
        assert divisor_below(number, most) == max(d for d in range(1, most + 1) if number % d == 0)


def test_the_nearest_divisor_of_large_numbers_is_found_at_once():
    assert divisor_below(10**12, 999_999_999) == 976_562_500
