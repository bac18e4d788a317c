import numpy as np
import pytest

from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.spec import Box, Observation, Spec, observation_of, spec_of
from hitmdp_jax.errors import UsageError

# name -> keywords, and where in the observation the parts other than the body lie
PARTS = {
    "halfcheetah": ({}, {}),
    "hopper": ({"exclude_current_positions_from_observation": False}, {"place": [0]}),
    "swimmer": ({"exclude_current_positions_from_observation": False}, {"place": [0, 1]}),
    "ant": ({"exclude_current_positions_from_observation": False}, {"place": [0, 1]}),
    "humanoid": ({"exclude_current_positions_from_observation": False}, {"place": [0, 1]}),
    "invertedpendulum": ({}, {"place": [0]}),
    "inverteddoublependulum": ({}, {"place": [0]}),
    "reacher": ({}, {"goal": [4, 5, 8, 9]}),
    "maze/point_umaze": ({}, {"place": [0, 1, 4, 5], "goal": [6, 7]}),
    "maze/ant_umaze": ({}, {"place": [105, 106], "goal": [107, 108]}),
}


@pytest.mark.parametrize("name", PARTS)
def test_tasks_name_the_parts_of_what_they_show(name):
    keywords, parts = PARTS[name]
    seen = spec_of(make_env(name, physics="native", **keywords)).observation
    assert sum(size for _, (size,) in seen.parts) == seen.size
    for part, places in parts.items():
        np.testing.assert_array_equal(seen.entries_of([part]), places)
    rest = set(range(seen.size)) - {x for places in parts.values() for x in places}
    np.testing.assert_array_equal(seen.entries_of(["body"]), sorted(rest))
    if "place" in parts and not name.startswith("maze/"):
        names = [seen.names[i] for i in parts["place"]]
        assert all("position" in name for name in names)


def test_parts_survive_json_and_are_found_in_the_order_of_the_row():
    parts = (("a", (2,)), ("b", ()), ("a", (1,)))
    spec = Spec(Observation((4,), parts=parts), Box.unlimited(1))
    assert Spec.from_dict(spec.to_dict()) == spec
    np.testing.assert_array_equal(spec.observation.entries_of(["b", "a"]), range(4))
    np.testing.assert_array_equal(spec.observation.entries_of(["a"]), [0, 1, 3])
    assert spec.observation.names == ("a[0]", "a[1]", "b", "a[0]")


def test_several_arrays_become_one_row_in_the_order_of_their_names():
    obs = {"b": np.array(True), "a": np.arange(6.0).reshape(2, 3)}
    seen = observation_of(obs)
    np.testing.assert_array_equal(seen.flat(obs), [0, 1, 2, 3, 4, 5, 1])
    assert seen.parts == (("a", (2, 3)), ("b", ()))


def test_a_part_that_there_is_not_is_explained():
    seen = Observation((3,), parts=(("body", (1,)), ("goal", (2,))))
    with pytest.raises(UsageError, match=r"'gaol'; did you mean 'goal'\? Valid: body, goal"):
        seen.entries_of(["body", "gaol"])
