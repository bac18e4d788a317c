"""The replay against a list that forgets its oldest."""

import collections

import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax.learning import replay as replays

C = 5


@hypothesis.given(st.lists(st.integers(1, 12), max_size=6))
def test_it_holds_the_newest_transitions(sizes):
    expected = collections.deque(maxlen=C)
    replay = replays.empty({"x": jnp.zeros(2), "n": jnp.zeros((), jnp.int32)}, C)
    count = 0
    for size in sizes:
        n = np.arange(count, count + size, dtype=np.int32)
        expected.extend(n.tolist())
        replay = replays.add(replay, {"x": np.stack([n, -n], 1).astype(np.float32), "n": n})
        count += size
    held = np.asarray(replay.data["n"])[: int(replay.size)]
    assert sorted(held.tolist()) == list(expected)
    np.testing.assert_array_equal(replay.data["x"][: len(held)], np.stack([held, -held], 1))


def test_samples_are_of_what_it_holds_and_of_all_of_it(key):
    replay = replays.add(replays.empty(jnp.zeros(()), 100), jnp.arange(1.0, 9.0))
    drawn = np.asarray(replays.sample(replay, key, 800))
    values, counts = np.unique(drawn, return_counts=True)
    assert values.tolist() == list(range(1, 9))
    assert counts.min() > 60  # of 100 on average, nine in standard deviation


def test_a_donated_replay_is_written_in_place():
    replay = replays.empty(jnp.zeros(3), 1000)
    add = jax.jit(replays.add, donate_argnums=0)
    before = replay.data.unsafe_buffer_pointer()
    replay = add(replay, jnp.ones((4, 3)))
    assert replay.data.unsafe_buffer_pointer() == before
    assert float(replay.data.sum()) == 12.0
