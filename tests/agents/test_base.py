"""Making agents, taking them apart, and finding them by name."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax import plugins
from hitmdp_jax.agents import MOPG, PPO, Agent, find_agent
from hitmdp_jax.agents.base import check_hyperparameters
from hitmdp_jax.errors import UsageError
from tests.probes import Target

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_algorithm.py"
PROBES = Path(__file__).parents[1] / "probes.py"


class Plain(PPO):
    """Fields without `traced` or `static`."""

    temperature: float = 1.0
    depth: int = 2
    kind: str = "soft"


@pytest.mark.parametrize("leaf", [None, object(), 0, "axis", jax.ShapeDtypeStruct((), float)])
def test_leaves_may_be_anything_while_jax_moves_them(leaf):
    agent = MOPG(hidden_sizes=(8,))
    moved = jax.tree.map(lambda _: leaf, agent)
    assert isinstance(moved, MOPG)
    assert moved.gamma is leaf
    assert moved.hidden_sizes == (8,)


def test_an_agent_of_axes_says_what_vmap_sweeps():
    axes = jax.tree.map(lambda _: None, MOPG()).replace(learning_rate=0)
    agent = MOPG(gamma=0.5).replace(learning_rate=jnp.array([0.1, 0.2]))
    result = jax.jit(jax.vmap(lambda a: a.learning_rate * a.gamma, in_axes=(axes,)))(agent)
    np.testing.assert_allclose(result, [0.05, 0.1], rtol=1e-6)


def test_agents_pass_through_transformations():
    agent = MOPG()
    assert jax.jit(lambda a: a.replace(gamma=a.gamma / 2))(agent).gamma == pytest.approx(0.495)
    assert jax.eval_shape(lambda a: a, agent).gamma.shape == ()
    assert jax.jit(jax.grad(lambda a: a.gamma**2))(agent).gamma == pytest.approx(1.98)
    again = jax.tree.unflatten(*reversed(jax.tree.flatten(agent)))
    assert again == agent
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree.leaves_with_path(agent)]
    assert ".learning_rate" in paths


def test_undeclared_floats_are_leaves_and_the_rest_is_static():
    agent = Plain(temperature=-2.0)
    leaves, tree = jax.tree.flatten(agent)
    assert len(leaves) == len(jax.tree.leaves(PPO())) + 1
    assert tree != jax.tree.structure(agent.replace(depth=3))
    with pytest.raises(UsageError, match="temperature = nan must be a finite number"):
        agent.replace(temperature=float("nan"))
    with pytest.raises(UsageError, match="depth = 0 must be a positive whole number"):
        Plain(depth=0)


def test_agents_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        PPO().gamma = 0.5


def test_no_clipping_is_an_infinite_bound():
    agent = PPO(max_grad_norm=float("inf"), clip_eps=float("inf"))
    with pytest.raises(UsageError, match="clip_eps = nan must be a number from 0 to inf"):
        agent.replace(clip_eps=float("nan"))


def test_a_list_of_sizes_is_as_good_as_a_tuple():
    assert PPO(hidden_sizes=[8, 8]) == PPO(hidden_sizes=(8, 8))


def test_a_class_is_no_agent():
    with pytest.raises(UsageError, match=r"agent is the class MOPG: pass an agent, MOPG\(\)"):
        check_hyperparameters(MOPG)


def test_an_unfinished_algorithm_says_what_it_lacks():
    class Unfinished(Agent):
        pass

    with pytest.raises(TypeError, match="act"):
        Unfinished()


def test_the_agent_that_acts_is_the_scheduled_one(key):
    """An acting parameter that is annealed acts."""

    class Silenced(PPO):
        loudness: float = 1.0

        def scheduled(self, progress):
            return self.replace(loudness=jnp.where(progress < 0.5, 1.0, 0.0))

        def act(self, params, obs, memory, key, deterministic=False):
            action, memory, record = super().act(params, obs, memory, key, deterministic)
            return self.loudness * action, memory, record

    # With the action 0 the mean reward is 1 - E x^2 = 2/3; a random one costs its variance.
    train = jax.jit(
        lambda k: hitmdp_jax.train(
            Silenced(learning_rate=0.0, hidden_sizes=(8,)),
            Target(),
            k,
            num_steps=2048,
            num_envs=64,
            rollout_length=16,
        )
    )
    returns = jax.device_get(train(key)[1]["episode_return"])
    assert returns[0] < 0.5
    assert returns[1] > 0.6


@pytest.fixture(autouse=True)
def named():
    """The files that are named here, as a command line would name them."""
    for name in (f"{EXAMPLE}:ClipHigher", f"{PROBES}:Target"):
        plugins.trust(name)


def test_agents_are_found_by_name_and_by_file():
    assert find_agent("mopg") is MOPG
    assert find_agent(f"{EXAMPLE}:ClipHigher") is find_agent(f"{EXAMPLE}:ClipHigher")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mopgg", "Unknown algo 'mopgg'; did you mean 'mopg'"),
        ("nowhere.py:Name", "there is no 'nowhere.py' here"),
        (f"{EXAMPLE}:ClipLower", "did you mean 'ClipHigher'"),
        (f"{PROBES}:Target", "is no algorithm"),
    ],
)
def test_what_is_not_found_is_explained(name, sentence):
    with pytest.raises(UsageError, match=sentence):
        find_agent(name)


def test_the_example_is_short_and_learns(key):
    assert len(EXAMPLE.read_text().splitlines()) < 40
    agent = find_agent(f"{EXAMPLE}:ClipHigher")(
        learning_rate=3e-3, num_epochs=2, hidden_sizes=(16,)
    )
    train = jax.jit(
        lambda k: hitmdp_jax.train(
            agent, Target(), k, num_steps=40 * 128, num_envs=8, rollout_length=16
        )
    )
    metrics = jax.device_get(train(key)[1])
    assert metrics["episode_return"][-5:].mean() > metrics["episode_return"][:3].mean() + 0.2
    assert (metrics["option_clip_fraction"] >= 0).all()
