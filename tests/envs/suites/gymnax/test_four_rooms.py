"""The four rooms of gymnax against a table of probabilities, and what is learned there."""

import functools
import importlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax import make_env, train
from hitmdp_jax.agents import MOPG, PPO
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.envs.suites.gymnax.four_rooms import DOORS, steps_to
from hitmdp_jax.interpret.episodes import run_episodes
from hitmdp_jax.runs.policy import Policy
from tests.envs.suites.gymnax.four_rooms import CELLS, MAP, STEPS, transitions, values
from tests.programs import OPTIMIZED, compiled

GOAL, FAIL = (8, 9), 1.0 / 3.0
DRAWS = 3000  # of each step: frequencies lie within .05 of their probabilities


@pytest.fixture(scope="module")
def env():
    return make_env("gymnax/FourRooms-misc", resample_init_pos=True, max_steps_in_episode=100)


def test_the_library_has_the_map_of_the_paper():
    rooms = importlib.import_module("gymnax.environments.misc.rooms")
    assert rooms.four_rooms_map.strip().splitlines() == MAP
    assert len(CELLS) == 104


def test_a_step_goes_where_the_table_says(env):
    """Each action in each cell, drawn often: the share that arrives, the reward and the end."""
    start = env.reset(jax.random.key(0))

    def arrived(cell, action, key):
        now = start.pipeline_state.replace(pos=cell, time=0)
        state = start.replace(pipeline_state=now, info=start.info | {"key": key})
        after = env.step(state, action)
        return after.obs[:2], after.reward, after.done

    @compiled
    def all_steps(keys):
        each = jax.vmap(arrived, (None, None, 0))
        each = jax.vmap(jax.vmap(each, (None, 0, None)), (0, None, None))
        return each(jnp.array(CELLS), jnp.arange(len(STEPS)), keys)

    place, reward, done = map(np.asarray, all_steps(jax.random.split(jax.random.key(1), DRAWS)))
    number = {cell: i for i, cell in enumerate(CELLS)}
    reached = np.vectorize(lambda y, x: number[y, x])(place[..., 0], place[..., 1])
    shares = np.stack([(reached == i).mean(-1) for i in range(len(CELLS))], axis=-1)
    np.testing.assert_allclose(shares.swapaxes(0, 1), transitions(FAIL), atol=0.05)
    at_goal = (place == GOAL).all(-1)
    np.testing.assert_array_equal(reward, at_goal)
    np.testing.assert_array_equal(done, at_goal)


def test_the_table_knows_the_best_way_through_a_door():
    """Without mishaps the best value is the discount to the power of the shortest way."""
    value = dict(zip(CELLS, values((1, 1), 0.0, 0.9), strict=True))
    assert value[1, 1] == 0.0  # an episode ends there
    np.testing.assert_allclose(value[1, 2], 1.0)
    np.testing.assert_allclose(value[3, 7], 0.9**7)  # two up and six left, and no wall on the way
    np.testing.assert_allclose(value[1, 7], 0.9**9)  # by the door, two down and up again


def test_the_place_and_the_goal_are_parts_of_the_observation(env):
    state = env.reset(jax.random.key(0))
    observation = env.spec.observation
    now = state.pipeline_state
    np.testing.assert_array_equal(state.obs[observation.entries_of(["place"])], now.pos)
    np.testing.assert_array_equal(state.obs[observation.entries_of(["goal"])], GOAL)
    seen = spec_of(make_env("gymnax/FourRooms-misc", use_visual_obs=True)).observation
    assert seen.size == 13 * 13 * 2


@pytest.mark.slow
@pytest.mark.parametrize("algo", [PPO, MOPG])
def test_what_is_learned_is_nearly_the_best_policy(algo, env):
    """Discounted returns of its own episodes, against the table's best from an average cell."""
    agent = algo()
    run = functools.partial(train, agent, env, num_steps=409_600)
    state, _ = compiled(run, compiler_options=OPTIMIZED)(jax.random.key(0))
    policy = Policy(agent.bind(env.spec), state.learner.params, state.normalizer)
    episodes = run_episodes(policy, env, jax.random.key(1), 1000)
    lengths, reached = np.asarray(episodes.alive.sum(0)), np.asarray(episodes.returns)
    mine = (reached * agent.gamma ** (lengths - 1.0)).mean()
    best = values(GOAL, FAIL, agent.gamma)[[cell != GOAL for cell in CELLS]].mean()
    assert 0.95 * best < mine < 1.02 * best


def test_options_are_paid_for_sides_and_for_doors(env):
    """A step east through the western rooms' door: towards two doors, and away from the others."""
    start = env.reset(jax.random.key(0))

    def at(cell):
        return start.replace(pipeline_state=start.pipeline_state.replace(pos=jnp.array(cell)))

    paid = env.option_rewards(at((3, 5)), jnp.array(1), at((3, 6)))
    assert {name: float(x) for name, x in paid.items()} == {
        "north": 0.0,
        "east": 1.0,
        "south": 0.0,
        "west": -1.0,
        "door_north": 1.0,
        "door_east": 1.0,
        "door_south": 1.0,  # 14 steps by either side before, 13 by the eastern rooms after
        "door_west": -1.0,
    }


@pytest.mark.parametrize("door", DOORS)
def test_the_way_to_a_door_is_the_tables(env, door):
    """The best value without mishaps and with the discount .5 tells how many steps it takes."""
    value = values(DOORS[door], 0.0, 0.5)
    steps = steps_to(DOORS[door], np.asarray(env.task.env_map))
    for cell, of_cell in zip(CELLS, value, strict=True):
        if cell != DOORS[door]:
            assert steps[cell] == round(1.0 - np.log2(of_cell)), cell
    assert steps[DOORS[door]] == 0
