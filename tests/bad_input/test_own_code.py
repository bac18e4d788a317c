"""What is wrong with a task or an algorithm of one's own: a row is a fault of a good one."""

import functools

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import Env, State
from flax import struct

import hitmdp_jax
from hitmdp_jax.agents import PPO
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.errors import UsageError
from tests.probes import PlaygroundTarget, Target, spec_of_sizes

SIZES = {"num_steps": 128, "num_envs": 8, "rollout_length": 16}


class Task(Env):
    """A task in which nothing happens; its faults are what its `parts` and attributes say."""

    observation_size, action_size, backend, episode_length = 3, 2, "none", 10
    first, then = {}, {}

    def reset(self, rng):
        parts = {
            "pipeline_state": rng,
            "obs": jnp.zeros(3),
            "reward": jnp.zeros(()),
            "done": jnp.zeros(()),
            "metrics": {"speed": jnp.zeros(())},
            "info": {},
        }
        return State(**parts | self.first)

    def step(self, state, action):
        return state.replace(**self.then)


def task(**attributes):
    """Return a `Task` with other attributes."""
    return type("Task", (Task,), attributes)()


def zeros(*shape, kind=jnp.float32):
    return np.zeros(shape, kind)


class Pixels(gymnasium.Env):
    """A task of Gymnasium's."""

    action_space = observation_space = gymnasium.spaces.Box(-1, 1, (3,))

    def reset(self, seed=None, options=None):
        return np.zeros(3), {}

    def step(self, action):
        return np.zeros(3), 0.0, False, False, {}


class Gymnax:
    """A task of gymnax's interface."""

    default_params = None

    def action_space(self, params=None): ...

    def reset(self, key, params=None):
        return jnp.zeros(3), None

    def step(self, key, state, action, params=None): ...


class Dm:
    """A task of dm_env's interface."""

    def reset(self): ...

    def step(self, action): ...

    def action_spec(self): ...


class Unknown:
    """A state of which JAX knows nothing."""

    obs = reward = done = metrics = info = None


class Floating(PlaygroundTarget):
    action_size = 2.0


TASKS = {
    # Another interface
    "Gymnasium's": (Pixels(), "its interface is that of Gymnasium"),
    "gymnax's": (Gymnax(), "its interface is that of gymnax"),
    "dm_env's": (Dm(), "its interface is that of dm_env"),
    "reset of more": (task(reset=lambda self, key, params: 0), "its reset must take key alone"),
    "reset of nothing": (task(reset=lambda self: 0), "its reset must take key alone"),
    "step of less": (task(step=lambda self, state: 0), "its step must take state and action alone"),
    "step of a key": (task(step=lambda self, k, s, a: 0), "its step must take state and action"),
    "a pair": (task(reset=lambda self, key: (jnp.zeros(3), {})), "its reset returns a tuple"),
    "an array": (task(reset=lambda self, key: jnp.zeros(3)), "without obs, reward, done"),
    "None": (task(reset=lambda self, key: None), "its reset returns a NoneType"),
    "a dictionary": (task(reset=lambda self, key: {"obs": 0}), "its reset returns a dict"),
    "no pytree": (task(reset=lambda self, key: Unknown()), "JAX knows no parts of its Unknown"),
    # Sizes
    "no action_size": (type("T", (), {"reset": 0, "step": 0})(), "has no action_size"),
    "action_size=0": (task(action_size=0), "action_size = 0 must be a positive whole number"),
    "action_size=-1": (task(action_size=-1), "action_size = -1 must be a positive whole number"),
    "action_size=2.0": (Floating(), "action_size = 2.0 must be a positive whole number"),
    "action_size=True": (task(action_size=True), "action_size = True must be a positive whole"),
    "action_size=(2,)": (task(action_size=(2,)), "action_size = (2,) must be a positive whole"),
    "episode_length=0": (task(episode_length=0), "episode_length = 0 must be a positive whole"),
    "episode_length=inf": (task(episode_length=np.inf), "episode_length = inf must be"),
    "episode_length=None": (task(episode_length=None), "episode_length = None must be"),
    # The observation
    "another shape": (task(spec=spec_of_sizes(4, 2)), "its spec says [4] and it observes"),
    "another spec": (task(spec=(3, 2)), "its spec is a tuple and must be a hitmdp_jax.Spec"),
    "a number": (task(first={"obs": zeros()}), "its observation is float32[] and must be a row"),
    "no number": (task(first={"obs": zeros(0)}), "its observation is float32[0] and must be"),
    "a tuple": (task(first={"obs": (zeros(3), zeros(3))}), "is a tuple and must be one array, or"),
    "a list": (task(first={"obs": [0.0, 0.0, 0.0]}), "its observation is a list and must be"),
    "no parts": (task(first={"obs": {}}), "its observation is a dictionary without arrays"),
    "numbered parts": (task(first={"obs": {0: zeros(3)}}), "part 0 must be called by a string"),
    "parts in parts": (task(first={"obs": {"a": {"b": zeros(3)}}}), "part 'a' is a dict and must"),
    "an empty part": (task(first={"obs": {"a": zeros(0)}}), "part 'a' is float32[0] and must be"),
    "other parts": (
        task(first={"obs": {"a": zeros(3)}}, spec=spec_of_sizes(3, 2)),
        "its spec says obs [3] and it observes a [3]",
    ),
    "no observation": (task(first={"obs": None}), "its observation is a NoneType"),
    "a word": (task(first={"obs": "far"}), "its observation is a str and must be one array"),
    "complex": (task(first={"obs": zeros(3, kind=jnp.complex64)}), "must be of real numbers"),
    # The reward, and the end
    "reward of one": (task(first={"reward": zeros(1)}), "its reward is float32[1] and must be one"),
    "reward of many": (task(first={"reward": zeros(8)}), "its reward is float32[8] and must be"),
    "reward None": (task(first={"reward": None}), "its reward is a NoneType and must be"),
    "done of one": (task(first={"done": zeros(1)}), "its done is float32[1] and must be one"),
    "truncation of one": (
        task(first={"info": {"truncation": zeros(1)}}),
        "its info['truncation'] is float32[1] and must be one",
    ),
    "done None": (task(first={"done": None}), "its done is a NoneType and must be one number"),
    "done a word": (task(first={"done": "no"}), "its done is a str and must be one number"),
    "whole reward": (task(then={"reward": 1}), "reward is float32[] of reset and int32[] of step"),
    "long reward": (task(then={"reward": zeros(3)}), "reset and float32[3] of step"),
    "done of another type": (task(then={"done": True}), "done is float32[] of reset and bool[]"),
    "done of actions": (task(then={"done": zeros(2)}), "reset and float32[2] of step"),
    "longer observation": (task(then={"obs": zeros(4)}), "obs is float32[3] of reset and float32"),
    "whole observation": (task(then={"obs": zeros(3, kind=jnp.int32)}), "reset and int32[3] of"),
    "lost observation": (task(then={"obs": None}), "reset makes obs, which step does not"),
    # What else is reported
    "metric of step": (task(then={"metrics": {"speed": 0.0, "far": 0.0}}), "step makes metrics['f"),
    "metric of reset": (task(then={"metrics": {}}), "reset makes metrics['speed'], which step"),
    "metric of a row": (task(first={"metrics": {"speed": zeros(3)}}), "is float32[3] and must be"),
    "metric of a word": (task(first={"metrics": {"gait": "trot"}}), "metric 'gait' is a str and"),
    "metric without name": (task(first={"metrics": {3: zeros()}}), "metric 3 must be called by a"),
    "metrics None": (task(first={"metrics": None}), "its metrics are a NoneType and must be"),
    "info None": (task(first={"info": None}), "its info is a NoneType and must be a dictionary"),
    "info of step": (task(then={"info": {"time": 0.0}}), "step makes info['time'], which reset"),
    "info of reset": (task(first={"info": {"time": 0.0}}, then={"info": {}}), "reset makes info["),
    "state of step": (task(then={"pipeline_state": zeros(3)}), "pipeline_state is key<fry>[] of"),
    "another structure": (
        task(first={"info": {"a": (zeros(),)}}, then={"info": {"a": [zeros()]}}),
        "reset and step make different structures",
    ),
    "step's own state": (task(step=lambda self, state, action: state.obs), "step returns float32"),
    "step's pair": (task(step=lambda self, state, action: (state, {})), "step returns a tuple"),
    **{
        f"metric {name}": (
            task(first={"metrics": {name: zeros()}}),
            f"its metric '{name}' would hide the training's of that name",
        )
        for name in (
            "episode_return", "episode_length", "episodes", "recent_return", "steps_per_second",
            "diverged", "value_loss", "action_kl", "option_steps", "learning_rate", "value",
        )
    },
}  # fmt: skip


class Algorithm(PPO):
    """A good algorithm, of one minibatch."""

    minibatch_size: int = 128
    num_epochs: int = 1
    hidden_sizes: tuple[int, ...] = (2,)


def algorithm(**methods):
    """Return an `Algorithm` with other methods."""
    return type("Algorithm", (Algorithm,), methods)()


def acts(change):
    def act(self, params, obs, memory, key, deterministic=False):
        return change(*PPO.act(self, params, obs, memory, key, deterministic))

    return act


def updates(change):
    def update(self, state, batch, key):
        return change(*PPO.update(self, state, batch, key))

    return update


class Counted(struct.PyTreeNode):
    count: jax.Array


ALGORITHMS = {
    "init of parameters": (algorithm(init=lambda *_: {}), "its init returns a dict and must"),
    "init of nothing": (algorithm(init=lambda *_: None), "its init returns a NoneType and must"),
    "memory of one": (algorithm(initial_memory=lambda *_: zeros(3)), "holds float32[3] and must"),
    "memory of a word": (algorithm(initial_memory=lambda *_: "none"), "holds a str and must be"),
    "action alone": (algorithm(act=acts(lambda a, m, r: a)), "act must return three things"),
    "act of two": (algorithm(act=acts(lambda a, m, r: (a, m))), "act must return three things"),
    "longer actions": (algorithm(act=acts(lambda a, m, r: (zeros(8, 3), m, r))), "float32[8, 3]"),
    "one action": (algorithm(act=acts(lambda a, m, r: (a[0], m, r))), "returns float32[1] for"),
    "no action": (algorithm(act=acts(lambda a, m, r: (None, m, r))), "a NoneType for actions"),
    "new memory": (algorithm(act=acts(lambda a, m, r: (a, zeros(8), r))), "its act makes what it"),
    "memory of another type": (
        algorithm(
            initial_memory=lambda *_: zeros(8), act=acts(lambda a, m, r: (a, zeros(8, 2), r))
        ),
        "float32[8] of its initial_memory and float32[8, 2] of its act",
    ),
    "update of a state": (algorithm(update=updates(lambda s, m: s)), "must return two things"),
    "update of a list": (algorithm(update=updates(lambda s, m: (s, [m]))), "return two things"),
    "lost optimiser": (
        algorithm(update=updates(lambda s, m: (s.replace(opt_state=()), m))),
        "which its update does not",
    ),
    "other parameters": (
        algorithm(update=updates(lambda s, m: (s.replace(params={}), m))),
        "its init makes params",
    ),
    "share of another type": (
        algorithm(update=updates(lambda s, m: (s.replace(rate_share=jnp.zeros(2)), m))),
        "rate_share is float32[] of its init and float32[2] of its update",
    ),
    "wide metric": (
        algorithm(update=updates(lambda s, m: (s, m | {"map": zeros(2, 2)}))),
        "its metric 'map' is float32[2, 2] and must be one number",
    ),
    "metric of a word": (
        algorithm(update=updates(lambda s, m: (s, m | {"how": "well"}))),
        "its metric 'how' is a str and must be one number",
    ),
    **{
        f"metric {name}": (
            algorithm(update=updates(lambda s, m, name=name: (s, m | {name: zeros()}))),
            f"its metric '{name}' would hide the training's of that name",
        )
        for name in ("episode_return", "episodes", "recent_return", "diverged")
    },
}  # fmt: skip


@pytest.mark.parametrize("fault", TASKS)
def test_a_task(fault):
    env, part = TASKS[fault]
    with pytest.raises(UsageError) as error:
        hitmdp_jax.make_train(PPO(minibatch_size=128), env, **SIZES)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("fault", ALGORITHMS)
def test_an_algorithm(fault):
    agent, part = ALGORITHMS[fault]
    with pytest.raises(UsageError) as error:
        hitmdp_jax.make_train(agent, Target(), **SIZES)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "env",
    [
        task(),
        Target(),
        PlaygroundTarget(),
        task(first={"obs": zeros(3, kind=jnp.int32)}),
        task(first={"done": np.False_, "reward": np.int32(0)}),
        task(first={"metrics": {"success": zeros(), "unstable": zeros()}}),
    ],
)
@pytest.mark.parametrize("agent", [Algorithm(), algorithm(act=acts(lambda *three: three))])
def test_good_ones_pass(env, agent):
    hitmdp_jax.make_train(agent, env, **SIZES)


def test_every_way_to_make_a_task_checks_it(tmp_path, monkeypatch):
    monkeypatch.setattr("hitmdp_jax.envs.registry._registered", {})
    hitmdp_jax.register_env("mine", functools.partial(task, action_size=0))
    with pytest.raises(UsageError, match="'mine' cannot be trained on: its action_size = 0"):
        hitmdp_jax.make_env("mine", action_repeat=2)
    (tmp_path / "own.py").write_text(
        "from tests.probes import Target\nclass Task(Target):\n    action_size = 0\n"
    )
    with pytest.raises(UsageError, match=r"'own.Task' cannot be trained on: its action_size = 0"):
        hitmdp_jax.make_env(f"{tmp_path}/own.py:Task")
    with pytest.raises(UsageError, match="has no reset and step"):
        hitmdp_jax.register_env("mine", dict)


def test_a_task_with_a_model_is_checked_without_its_physics():
    """Tracing MJX takes seconds, and a fault is in what the subclass adds."""
    pendulum = hitmdp_jax.make_env("invertedpendulum", physics="native")

    class Own(type(pendulum)):
        def reward(self, before, after, action):
            return jnp.zeros(2), super().reward(before, after, action)[1]

    env = Own(physics="native")
    assert isinstance(env, MujocoEnv)
    with pytest.raises(UsageError, match=r"is float32\[\] of reset and float32\[2\] of step"):
        hitmdp_jax.make_train(PPO(minibatch_size=128), env, **SIZES)


def test_what_ones_own_code_raises_is_ones_own_to_see():
    def step(self, state, action):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        hitmdp_jax.make_train(PPO(minibatch_size=128), task(step=step), **SIZES)
