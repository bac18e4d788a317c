"""What is wrong in a call from Python: a row is the call and a part of the sentence."""

import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax.agents import AHP, DAC, IOPG, MOPG, OC, PPO, PPOC
from hitmdp_jax.envs.suites.toy.turkey import Turkey
from hitmdp_jax.errors import UsageError
from hitmdp_jax.interpret.evaluation import score_each
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.video.rendering import Painter
from tests.probes import Target, untrained

SIZES = {"num_steps": 128, "num_envs": 8, "rollout_length": 16}
make_train = functools.partial(hitmdp_jax.make_train, **SIZES)


class Several(Target):
    def reset(self, rng):
        state: Any = super().reset(rng)
        return state.replace(obs=(state.obs, state.obs))


PYTHON = {
    "make_env(None)": (lambda: hitmdp_jax.make_env(None), "env = None must be the name"),
    "make_env(3)": (lambda: hitmdp_jax.make_env(3), "env = 3 must be the name"),
    "make_env([])": (lambda: hitmdp_jax.make_env([]), "env = [] must be the name"),
    "make_env('')": (lambda: hitmdp_jax.make_env(""), "Unknown environment ''"),
    "make_env('brax/')": (lambda: hitmdp_jax.make_env("brax/"), "Unknown environment 'brax/'"),
    "env misspelt": (lambda: hitmdp_jax.make_env("hoper"), "did you mean 'hopper'?"),
    "keyword misspelt": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_weight=1),
        "Unknown keyword of hopper 'ctrl_weight'",
    ),
    "keyword of wrong type": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_cost_weight="a"),
        "ctrl_cost_weight = a must be a finite number",
    ),
    "keyword NaN": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_cost_weight=np.float32("nan")),
        "ctrl_cost_weight = nan must be a finite number",
    ),
    "keyword array": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_cost_weight=np.ones(3)),
        "must be a finite number",
    ),
    "action_repeat of 1e12": (
        lambda: hitmdp_jax.make_env("hopper", action_repeat=10**12),
        "action_repeat = 1000000000000 must be a positive whole number, at most 2,147,483,647",
    ),
    "picture without width": (lambda: Painter(None, (0, 480)), "width = 0 must be a positive"),  # pyright: ignore
    "picture too high": (
        lambda: Painter(None, (640, 10**9)),  # pyright: ignore
        "height = 1000000000 must be a positive whole number, at most 32,768",
    ),
    "version None": (lambda: hitmdp_jax.make_env("hopper", version=None), "Unknown version 'None'"),
    "version 5": (lambda: hitmdp_jax.make_env("hopper", version=5), "Unknown version '5'"),
    "version []": (lambda: hitmdp_jax.make_env("hopper", version=[]), "Unknown version '[]'"),
    "physics None": (lambda: hitmdp_jax.make_env("hopper", physics=None), "Unknown physics 'None'"),
    "physics misspelt": (lambda: hitmdp_jax.make_env("hopper", physics="natve"), "'native'?"),
    "register built-in": (lambda: hitmdp_jax.register_env("hopper", Turkey), "built-in"),
    "register brax": (lambda: hitmdp_jax.register_env("brax/ant", Turkey), "built-in"),
    "register nothing": (lambda: hitmdp_jax.register_env("mine", None), "constructor = None"),
    "register object": (lambda: hitmdp_jax.register_env("mine", Target()), "constructor"),
    "register None": (lambda: hitmdp_jax.register_env(None, Turkey), "name = None"),
    "register ''": (lambda: hitmdp_jax.register_env("", Turkey), "name = ''"),
    "agent class": (lambda: make_train(PPO, Target()), "pass an agent, PPO()"),
    "agent name": (lambda: make_train("ppo", Target()), "'ppo' is not an agent"),
    "agent None": (lambda: make_train(None, Target()), "None is not an agent"),
    "env name": (lambda: make_train(PPO(), "hopper"), "make_env('hopper')"),
    "env class": (lambda: make_train(PPO(), Turkey), "Turkey"),
    "env None": (lambda: make_train(PPO(), None), "None"),
    "env of several arrays": (lambda: make_train(PPO(), Several()), "is a tuple and must be"),
    "batch that does not divide": (
        lambda: hitmdp_jax.make_train(PPO(minibatch_size=100), Target(), **SIZES),
        "not divisible by minibatch_size = 100",
    ),
    "train without steps": (
        lambda: hitmdp_jax.train(PPO(), Target(), jax.random.key(0), num_steps=0),
        "num_steps = 0 must be a positive whole number",
    ),
    "train of a class": (
        lambda: hitmdp_jax.train(PPO, Target(), jax.random.key(0), num_steps=1),
        "pass an agent",
    ),
    "train of a number": (
        lambda: hitmdp_jax.train(PPO(), Target(), 0, **SIZES),
        "key = 0 must be a key",
    ),
    **{
        f"{name}={value!r}": (
            lambda name=name, value=value: hitmdp_jax.make_train(
                PPO(), Target(), **(SIZES | {name: value})
            ),
            f"{name} = {value} must be a positive whole number",
        )
        for name, value in [
            ("num_steps", "a"),
            ("num_steps", 0),
            ("num_steps", True),
            ("num_steps", 2.5),
            ("num_steps", None),
            ("num_envs", -8),
            ("num_envs", "8"),
            ("rollout_length", np.inf),
            ("rollout_length", [16]),
            ("episode_length", 0),
            ("episode_length", -1),
            ("episode_length", "long"),
            ("reset_pool_size", 0),
            ("reset_pool_size", 1.5),
        ]
    },
    **{
        f"{agent.__name__}({name}={getattr(value, '__name__', repr(value))})": (
            lambda agent=agent, name=name, value=value: agent(**{name: value}),
            part,
        )
        for agent, name, value, part in [
            (PPO, "learning_rate", "fast", "learning_rate = fast must be a finite number from 0"),
            (PPO, "learning_rate", np.nan, "learning_rate = nan must be a finite number from 0"),
            (PPO, "learning_rate", -1.0, "learning_rate = -1.0 must be a finite number from 0"),
            (PPO, "learning_rate", None, "learning_rate = None must be a finite number from 0"),
            (PPO, "learning_rate", [1e-3], "learning_rate = [0.001] must be a finite number"),
            (PPO, "gamma", 2, "gamma = 2 must be a number from 0 to 1"),
            (PPO, "hidden_sizes", 64, "hidden_sizes = 64 must be a list"),
            (PPO, "hidden_sizes", (), "hidden_sizes = [] must be a list"),
            (PPO, "hidden_sizes", (0,), "hidden_sizes = [0] must be a list"),
            (PPO, "hidden_sizes", ("a",), "hidden_sizes = ['a'] must be a list"),
            (PPO, "hidden_sizes", np.array([64, 64]), "must be a list"),
            (PPO, "activation", "gelo", "Unknown activation 'gelo'"),
            (PPO, "activation", None, "Unknown activation 'None'"),
            (PPO, "activation", jnp.tanh, "Unknown activation"),
            (PPO, "num_epochs", 0, "num_epochs = 0 must be a positive whole number"),
            (PPO, "num_epochs", 1.5, "num_epochs = 1.5 must be a positive whole number"),
            (PPO, "bootstrap_on_truncation", 1, "must be true or false"),
            (MOPG, "num_options", True, "num_options = True must be a positive whole number"),
            (MOPG, "initial_log_std", 11.0, "must be a number from -10 to 10"),
            (MOPG, "entropy_schedule", "cubic", "Unknown entropy_schedule 'cubic'"),
            (DAC, "num_options", "4", "num_options = 4 must be a positive whole number"),
            (AHP, "num_options", -1, "num_options = -1 must be a positive whole number"),
            (PPOC, "clip_eps", "wide", "clip_eps = wide must be a number"),
            (IOPG, "num_options", 0, "num_options = 0 must be a positive whole number"),
            (OC, "num_options", 2.0, "num_options = 2.0 must be a positive whole number"),
            (OC, "colour", "red", "Unknown hyperparameter of OC 'colour'"),
            (PPO, "learningrate", 1e-3, "did you mean 'learning_rate'?"),
        ]
    },
    "replace by a bad value": (lambda: PPO().replace(gamma=np.inf), "gamma = inf must be a number"),
    "replace of nothing": (lambda: PPO().replace(gama=0.9), "did you mean 'gamma'?"),
    "load nowhere": (lambda: hitmdp_jax.load("nowhere"), "'nowhere' is not a run's folder"),
    "load ''": (lambda: hitmdp_jax.load(""), "run_dir = ''"),
    "load None": (lambda: hitmdp_jax.load(None), "run_dir = None"),
    "load seed": (lambda: hitmdp_jax.load("run", seed=99), "seed = 99 is not in the run"),
    "load seed word": (lambda: hitmdp_jax.load("run", seed="a"), "seed = a is not in the run"),
    "load seed []": (lambda: hitmdp_jax.load("run", seed=[]), "seed = [] is not in the run"),
    "load checkpoint": (lambda: hitmdp_jax.load("run", checkpoint=9), "holds no checkpoint 9"),
    "load checkpoint word": (lambda: hitmdp_jax.load("run", checkpoint="old"), "checkpoint old"),
    "load checkpoint None": (lambda: hitmdp_jax.load("run", checkpoint=None), "checkpoint None"),
    "load checkpoint 1.5": (lambda: hitmdp_jax.load("run", checkpoint=1.5), "checkpoint 1.5"),
    "load misfit": (lambda: hitmdp_jax.load("misfit"), "does not fit the algorithm"),
    "load torn": (lambda: hitmdp_jax.load("torn"), "No checkpoint in"),
    "save nothing": (lambda: hitmdp_jax.save("new", PPO(), None), "state is a NoneType"),
    "save parameters": (lambda: hitmdp_jax.save("new", PPO(), {"a": 1}), "state is a dict"),
    "save over a run": (
        lambda: hitmdp_jax.save("run", PPO(), untrained(PPO(), 1)),
        "'run' already holds a run",
    ),
    "save into a file": (
        lambda: hitmdp_jax.save("notes.txt", PPO(), untrained(PPO(), 1)),
        "notes.txt is not a folder",
    ),
    "save a class": (lambda: hitmdp_jax.save("new", PPO, untrained(PPO(), 1)), "PPO"),
    "save another agent": (
        lambda: hitmdp_jax.save("new", DAC(), untrained(PPO(), 1)),
        "does not fit",
    ),
    "save None": (lambda: hitmdp_jax.save("new", None, untrained(PPO(), 1)), "not an agent"),
    "act on a number": (lambda: act(3.0), "obs has shape ()"),
    "act on a wrong size": (lambda: act(np.zeros(99)), "obs has shape (99,)"),
    "act on a batch of wrong size": (lambda: act(np.zeros((2, 99))), "obs has shape (2, 99)"),
    "act on words": (lambda: act("abc"), "obs"),
    "score in no engine": (lambda: scored(engine="gym"), "Unknown engine 'gym'"),
    "score in None": (lambda: scored(engine=None), "Unknown engine 'None'"),
    "score no episodes": (lambda: scored(episodes=0), "episodes = 0 must be"),
    "score half an episode": (lambda: scored(episodes=0.5), "episodes = 0.5 must be"),
    "score words": (lambda: scored(episodes="a"), "episodes = a must be"),
    "score a run of no task": (
        lambda: RunConfig.load(Path("from_python")).task_at(1),
        "names no task",
    ),
    "read settings of nowhere": (lambda: RunConfig.load(Path("nowhere")), "is not a run's folder"),
    "settings without a name": (
        lambda: RunConfig.from_mapping({"algo": {}}),
        "algo = {} must hold a name",
    ),
    "settings without an algorithm": (
        lambda: RunConfig.from_mapping({"env": {"name": "hopper"}}),
        "algo = None must hold a name",
    ),
}  # fmt: skip


def act(obs):
    policy = hitmdp_jax.load("run")
    return policy.act(obs, policy.initial_memory(jax.random.key(0)), jax.random.key(0))


def scored(engine="mjx", episodes=1):
    key = jax.random.key(0)
    return score_each(hitmdp_jax.load("run"), {"name": "hopper"}, engine, episodes, [key])


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize("mistake", PYTHON)
def test_python(mistake):
    call, part = PYTHON[mistake]
    with pytest.raises(UsageError) as error:
        call()
    assert part in str(error.value)
    assert "\n" not in str(error.value)
