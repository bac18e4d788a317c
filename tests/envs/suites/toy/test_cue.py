import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax import UsageError, make_env
from hitmdp_jax.envs.suites.toy.cue import SEEN, Cue

LENGTH = 3


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("turn", [0, 1])
def test_the_cue_decides_the_turn(seed, turn):
    """The walk is three steps, in which actions count for nothing; then comes the turn."""
    env = Cue(LENGTH)
    state = env.reset(jax.random.key(seed))
    cue = int(np.argmax(state.obs))
    assert SEEN[cue] in ("cue left", "cue right")
    for step in range(LENGTH):
        state = env.step(state, jnp.int32(step % 2))
        assert (float(state.reward), float(state.done)) == (0.0, 0.0)
        place = "junction" if step == LENGTH - 1 else "corridor"
        np.testing.assert_array_equal(state.obs, np.eye(len(SEEN))[SEEN.index(place)])
    state = env.step(state, jnp.int32(turn))
    right = SEEN[cue] == f"cue {env.spec.action.names[turn]}"
    assert float(state.reward) == (1.0 if right else -1.0)
    assert (float(state.done), float(state.metrics["success"])) == (1.0, float(right))


def test_both_cues_are_shown():
    shown = jax.vmap(Cue().reset)(jax.random.split(jax.random.key(0), 200)).obs.mean(axis=0)
    np.testing.assert_allclose(shown, [0.5, 0.5, 0.0, 0.0], atol=0.1)


def test_it_has_a_name_and_a_length():
    assert make_env("toy/cue", length=4).spec.episode_length == 5
    with pytest.raises(UsageError, match="length"):
        make_env("toy/cue", length=0)
