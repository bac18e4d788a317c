"""What the choices of gymnax's tasks are called, against what they do."""

import jax
import numpy as np
import pytest

from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.suites.gymnax.task import ACTION_NAMES

SIDE = {"left": -1, "stay": 0, "coast": 0, "right": 1}


def moved(name, read, **keywords):
    """Return what each action changes of what is read of the library's state, by name."""
    env = make_env(f"gymnax/{name}", **keywords)
    start = jax.jit(env.reset)(jax.random.key(0))
    changes = {}
    for action, called in enumerate(env.spec.action.names):
        state = jax.jit(env.step)(start, np.int32(action))
        changes[called] = np.asarray(read(state.pipeline_state) - read(start.pipeline_state))
    return changes


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("Catch-bsuite", lambda state: state.paddle_x),
        ("CartPole-v1", lambda state: state.x_dot),
        ("MountainCar-v0", lambda state: state.velocity),
    ],
)
def test_left_and_right_are_where_they_say(name, read):
    """Of the car, beside where the hill pulls it."""
    changes = moved(name, read)
    assert tuple(changes) == ACTION_NAMES[name]
    still = changes.get("stay", changes.get("coast", 0.0))
    assert {called: np.sign(by - still) for called, by in changes.items()} == {
        called: SIDE[called] for called in changes
    }


def test_the_sides_of_the_four_rooms_are_those_of_a_map():
    """The first square has a wall in the west alone; rows count from the north."""
    changes = moved("FourRooms-misc", lambda state: state.pos, fail_prob=0.0)
    assert {side: by.tolist() for side, by in changes.items()} == {
        "north": [-1, 0], "east": [0, 1], "south": [1, 0], "west": [0, 0],
    }  # fmt: skip
