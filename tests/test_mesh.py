import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AxisType, NamedSharding
from jax.sharding import PartitionSpec as P

from hitmdp_jax.mesh import DATA, each_device, in_chunks, on_every_device, over_data


@pytest.fixture
def mesh():
    return jax.make_mesh((2,), (DATA,), (AxisType.Auto,))


def rows_seen(num_rows):
    """Return the rows that a function was traced for, and what it made of all of them."""
    seen = []

    @jax.jit
    def doubled(x):
        return each_device(lambda x: (seen.append(len(x)), 2 * x)[1], x)

    x = np.arange(2.0 * num_rows, dtype=np.float32).reshape(num_rows, 2)
    np.testing.assert_array_equal(doubled(x), 2 * x)
    return seen[-1]


def test_without_a_mesh_nothing_is_spread():
    assert rows_seen(4) == 4
    x = jnp.ones(4)
    assert over_data(x, 0) is x
    assert on_every_device(x) is x


def test_each_device_computes_its_own_rows(mesh):
    with jax.set_mesh(mesh):
        assert rows_seen(4) == 2


def test_each_device_computes_all_rows_that_do_not_divide(mesh):
    with jax.set_mesh(mesh):
        assert rows_seen(3) == 3
        assert over_data(jnp.ones(3), 0).shape == (3,)


def test_an_axis_is_laid_out_over_the_devices_and_brought_back(mesh):
    with jax.set_mesh(mesh):
        spread = jax.jit(lambda x: over_data(x, 1))(jnp.ones((3, 4)))
        whole = jax.jit(on_every_device)(spread)
    assert spread.sharding.is_equivalent_to(NamedSharding(mesh, P(None, DATA)), 2)
    assert whole.sharding.is_fully_replicated


def test_an_axis_that_is_spread_by_hand_is_left_alone(mesh):
    """Who maps trainings over an axis of the same name has used it up."""
    whole = jax.shard_map(
        lambda x: over_data(each_device(lambda y: y + len(y), x), 0),
        mesh=mesh, in_specs=P(DATA), out_specs=P(DATA),
    )  # fmt: skip
    np.testing.assert_array_equal(whole(np.zeros(4)), [2, 2, 2, 2])


@pytest.mark.parametrize("size", [1, 3, 6, 7, 9])
def test_rows_in_chunks_are_those_of_all_at_once(size):
    """Keys, numbers, and arrays without entries, as the states of simulators have them."""
    seen = []
    keys = jax.random.split(jax.random.key(0), 7)
    batch = {"key": keys, "x": jnp.arange(14.0).reshape(7, 2), "none": jnp.zeros((7, 0, 3))}

    def one(row):
        seen.append(row["x"].shape)
        return row | {"drawn": row["x"].sum() + jax.random.normal(row["key"], (2,))}

    every, chunked = jax.vmap(one)(batch), jax.jit(lambda x: in_chunks(one, x, size))(batch)
    assert set(seen) == {(2,)}
    np.testing.assert_array_equal(*(jax.random.key_data(x.pop("key")) for x in (every, chunked)))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6), every, chunked)
