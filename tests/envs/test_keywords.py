"""Keywords are checked in a sentence before a task is made."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hitmdp_jax.envs import check_env
from hitmdp_jax.envs.keywords import check_keywords, parameters_of
from hitmdp_jax.envs.suites.gym.hopper import Hopper
from hitmdp_jax.errors import UsageError


@pytest.mark.parametrize(
    ("name", "keyword", "value", "wanted"),
    [
        ("halfcheetah", "ctrl_cost_weight", "abc", "a finite number"),
        ("halfcheetah", "ctrl_cost_weight", math.nan, "a finite number"),
        ("halfcheetah", "ctrl_cost_weight", math.inf, "a finite number"),
        ("halfcheetah", "ctrl_cost_weight", None, "a finite number"),
        ("halfcheetah", "ctrl_cost_weight", True, "a finite number"),
        ("halfcheetah", "reset_noise_scale", -3, "a finite number from 0"),
        ("halfcheetah", "reset_noise_scale", math.inf, "a finite number from 0"),
        ("halfcheetah", "reset_noise_scale", "abc", "a finite number from 0"),
        ("hopper", "terminate_when_unhealthy", 1, "true or false"),
        ("hopper", "terminate_when_unhealthy", "no", "true or false"),
        ("hopper", "healthy_z_range", [2], "two numbers, the lower first"),
        ("hopper", "healthy_z_range", [2, 1], "two numbers, the lower first"),
        ("hopper", "healthy_z_range", [1, 2, 3], "two numbers, the lower first"),
        ("hopper", "healthy_z_range", [math.nan, 1], "two numbers, the lower first"),
        ("hopper", "healthy_z_range", 2, "two numbers, the lower first"),
        ("ant", "main_body", 1.5, "a whole number or a string"),
        ("ant", "use_contact_forces", "no", "true or false or null"),
        ("humanoid", "contact_cost_weight", math.inf, "a finite number or null"),
        ("maze/ant_umaze", "reward_type", "denze", "sparse or dense"),
        ("maze/ant_umaze", "reward_type", None, "sparse or dense"),
        ("maze/ant_umaze", "continuing_task", "yes", "true or false"),
        ("brax/ant", "healthy_z_range", [2], "two numbers, the lower first"),
        ("brax/ant", "reset_noise_scale", -1, "a finite number from 0"),
    ],
)
def test_a_value_that_is_not_valid_is_named_with_what_is(name, keyword, value, wanted):
    with pytest.raises(UsageError) as error:
        check_env(name, **{keyword: value})
    assert str(error.value) == f"{keyword} = {value} must be {wanted}."


@pytest.mark.parametrize(
    ("name", "keyword", "value"),
    [
        ("halfcheetah", "ctrl_cost_weight", 1),
        ("halfcheetah", "ctrl_cost_weight", -0.1),
        ("halfcheetah", "ctrl_cost_weight", np.float32(0.1)),
        ("halfcheetah", "ctrl_cost_weight", jnp.float32(0.1)),
        ("halfcheetah", "reset_noise_scale", 0),
        ("hopper", "healthy_z_range", [0.5, math.inf]),
        ("hopper", "healthy_z_range", (1, 1)),
        ("ant", "main_body", 1),
        ("ant", "use_contact_forces", None),
        ("humanoid", "contact_cost_weight", None),
        ("maze/ant_umaze", "reward_type", "dense"),
    ],
)
def test_every_valid_value_passes(name, keyword, value):
    check_env(name, **{keyword: value})


def test_traced_values_are_left_to_the_program():
    def checked(weight):
        check_env("halfcheetah", ctrl_cost_weight=weight)
        check_env("hopper", healthy_z_range=(weight, 2.0))
        return weight

    assert jax.jit(checked)(0.5) == 0.5


class Plain:
    def __init__(self, goal, size=2, speed=1.0, path=("a", "b"), depth: "int | None" = None):
        pass


@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({}, "mine needs the keyword 'goal'."),
        ({"goal": 1, "siz": 2}, "Unknown keyword of mine 'siz'; did you mean 'size'?"),
        ({"goal": 1, "size": 1.5}, "size = 1.5 must be a whole number."),
        ({"goal": 1, "speed": "fast"}, "speed = fast must be a number."),
        ({"goal": 1, "path": "a"}, "path = a must be a list."),
        ({"goal": 1, "depth": "a"}, "depth = a must be a whole number or null."),
    ],
)
def test_a_constructor_is_checked_by_annotations_and_defaults(keywords, sentence):
    with pytest.raises(UsageError) as error:
        check_keywords("mine", Plain, keywords, domains=False)
    assert str(error.value).startswith(sentence)
    check_keywords("mine", Plain, {"goal": "a", "speed": math.inf, "path": [1]}, domains=False)


def test_annotations_that_cannot_be_evaluated_are_not_checked():
    def constructor(size: "Missing" = 1):  # noqa: F821 # pyright: ignore
        pass

    check_keywords("mine", constructor, {"size": "a"})


def test_keywords_that_a_class_hands_on_are_those_of_the_class_above():
    class LowHopper(Hopper):
        def __init__(self, height=0.5, **kwargs):
            super().__init__(healthy_z_range=(height, math.inf), **kwargs)

    taken = parameters_of(LowHopper)
    assert list(taken)[:3] == ["height", "physics", "version"]
    assert "ctrl_cost_weight" in taken
    assert "kwargs" not in taken
    with pytest.raises(UsageError, match=r"terminate_when_unhealthy = 3 must be true or false"):
        check_keywords("mine", LowHopper, {"terminate_when_unhealthy": 3}, domains=False)


def test_a_function_that_takes_any_keyword_gets_it():
    def constructor(size=1, **anything):
        pass

    check_keywords("mine", constructor, {"colour": "red"})
    check_keywords("mine", functools.partial(constructor, size=2), {"colour": "red"})
    with pytest.raises(UsageError, match=r"size = a must be a whole number"):
        check_keywords("mine", constructor, {"size": "a"})
