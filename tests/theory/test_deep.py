import numpy as np
import pytest
from hypothesis import given

from hitmdp_jax.agents.hit_policy import remember
from hitmdp_jax.theory import remembered
from tests.programs import compiled
from tests.theory import exact

from .strategies import SHAPE, few, hit_mdps, random_hit_mdp

_, K, _ = SHAPE


@few
@given(hit_mdps())
def test_order_one_is_v_bar(hit):
    np.testing.assert_allclose(exact.deep_value(hit, 1), exact.hidden_values(hit).v_bar, atol=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_older_options_say_nothing_more(order):
    """E[G | s, o_{t-1}, o_{t-2}, ...] = V-bar[s, o_{t-1}]: the older ones are screened off."""
    hit = random_hit_mdp(seed=1)
    newest = np.arange(K**order) % K
    expected = exact.hidden_values(hit).v_bar[:, newest]
    np.testing.assert_allclose(exact.deep_value(hit, order), expected, atol=1e-10)


def test_memories_are_those_of_the_agent():
    both = compiled(lambda memory, option: (remembered(K, 2), remember(memory, option, K, 2)))
    memory, option = np.meshgrid(np.arange(K**2), np.arange(K), indexing="ij")
    np.testing.assert_array_equal(*both(memory, option))
