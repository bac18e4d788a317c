import functools

import gymnasium
import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import onnxruntime
import pytest
from brax.training.acme.running_statistics import NestedMeanStd

from hitmdp_jax.agents import AGENTS, PPOGRU
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.errors import UsageError
from hitmdp_jax.export.program import FORMATS, export
from hitmdp_jax.runs.policy import Policy
from tests.agents.option_batches import normal, random_params

READS = {"ppo": {"action_reads": ("body",)}}  # its policy has the columns of a part alone


@functools.cache
def policy_of(name):
    """A policy for the pendulum whose parameters are all drawn, so that each of them matters."""
    agent = AGENTS[name](hidden_sizes=(8,), spec=spec_of(pendulum()), **READS.get(name, {}))
    draw = np.random.default_rng(1)
    mean, std = 0.1 * normal(draw, 4), draw.uniform(0.1, 1.1, 4).astype(np.float32)
    return Policy(agent, random_params(agent), NestedMeanStd(mean, std))


@functools.cache
def pendulum():
    return make_env("invertedpendulum", physics="native")


@functools.cache
def runner(name, format_name):
    """Return an exported policy as a function of arrays by name, and its contract."""
    content, contract = export(policy_of(name), format_name)
    outputs = [x["name"] for x in contract["outputs"]]
    if format_name == "onnx":
        session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
        assert [x.name for x in session.get_inputs()] == [x["name"] for x in contract["inputs"]]
        assert [x.name for x in session.get_outputs()] == outputs

        def run(**inputs):
            return dict(zip(outputs, session.run(None, inputs), strict=True))
    else:
        call = jax.jit(jax.export.deserialize(bytearray(content)).call)

        def run(**inputs):
            found = call(*(inputs[x["name"]] for x in contract["inputs"]))
            return dict(zip(outputs, map(np.asarray, found), strict=True))

    return run, contract


def exported_actor(name, format_name):
    """Return what starts an episode, and acts in it, by the contract alone."""
    run, contract = runner(name, format_name)
    types = {x["name"]: x["dtype"] for x in contract["inputs"]}
    start = {x["name"]: [x["initial"]] for x in contract["inputs"] if "initial" in x}

    def act(obs, memory):
        inputs = {"obs": obs[None]} | memory
        found = run(**{n: np.asarray(x, types[n]) for n, x in inputs.items()})
        return found["action"][0], {n: found[f"next_{n}"] for n in memory}

    return start, act


def own_actor(name, start):
    """Return what starts an episode with the same memory, and acts in it, by `Policy.act`."""
    policy, key = policy_of(name), jax.random.key(0)
    structure = jax.tree.structure(policy.initial_memory(key))
    like = jax.tree.leaves(policy.initial_memory(key))
    leaves = [jnp.asarray(x[0], y.dtype) for x, y in zip(start.values(), like, strict=True)]

    @jax.jit
    def act(obs, memory):
        return policy.act(obs, memory, key, deterministic=True)

    return jax.tree.unflatten(structure, leaves), act


def play(start, act, episodes=4):
    """Play in Gymnasium's own pendulum; return the actions and the score."""
    env, memory = gymnasium.make("InvertedPendulum-v5"), start
    actions, total = [], 0.0
    for seed in range(episodes):
        obs, _ = env.reset(seed=seed)
        memory, done = start, False
        while not done and len(actions) < 400:
            action, memory = act(obs.astype(np.float32), memory)
            actions.append(np.clip(np.asarray(action), -3.0, 3.0))
            obs, reward, terminated, truncated, _ = env.step(actions[-1])
            total, done = total + float(reward), terminated or truncated
    return np.array(actions), total


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize("name", ["mopg", "ppo", "dac"])
def test_an_exported_policy_plays_in_gymnasium_as_the_policy_itself(name, format_name):
    start, act = exported_actor(name, format_name)
    actions, score = play(start, act)
    own_actions, own_score = play(*own_actor(name, start))
    np.testing.assert_allclose(actions, own_actions, rtol=0, atol=1e-5)
    assert score == own_score
    assert np.ptp(actions) > 0.1


@pytest.mark.parametrize("format_name", ["onnx", pytest.param("stablehlo", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", sorted(AGENTS))
def test_every_algorithm_is_exported_with_its_memory(name, format_name):
    run, contract = runner(name, format_name)
    policy, key = policy_of(name), jax.random.key(2)
    obs = np.asarray(jax.random.normal(key, (64, 4)))
    memory = policy.initial_memory(key, (64,))
    names = [x["name"] for x in contract["inputs"][1:]]
    act = jax.jit(lambda memory: policy.act(obs, memory, key, deterministic=True))
    for _ in range(2):  # an episode's first step, and one that remembers
        leaves = dict(zip(names, map(np.asarray, jax.tree.leaves(memory)), strict=True))
        found = run(obs=obs, **leaves)
        action, memory = act(memory)
        np.testing.assert_allclose(found["action"], action, atol=1e-5)
        for n, x in zip(names, jax.tree.leaves(memory), strict=True):
            np.testing.assert_allclose(found[f"next_{n}"], x, atol=1e-4)
        assert_alternatives(found, policy, obs, leaves)
        assert {n: x.dtype.name for n, x in found.items()} == {
            x["name"]: x["dtype"] for x in contract["outputs"]
        }


def assert_alternatives(found, policy, obs, remembered):
    """Hold what is said of other actions and options against the agent's own distributions."""

    @jax.jit
    def own(policy, remembered):
        agent, params, seen = policy.agent, policy.params, policy.normalized(obs)
        structure = jax.tree.structure(policy.initial_memory(jax.random.key(0)))
        memory = jax.tree.unflatten(structure, remembered)
        chosen = agent.policy(params, seen, found.get("option"))
        std = None if chosen is None else chosen.stddev()
        return std, agent.option_probs(params, seen, memory)

    std, probs = own(policy, list(remembered.values()))
    if std is None:
        assert isinstance(policy.agent, PPOGRU)
        assert "action_std" not in found
    else:
        np.testing.assert_allclose(found["action_std"], std, rtol=1e-5)
    if probs is None:
        assert not {"option", "option_logits"} & set(found)
        return
    np.testing.assert_allclose(np.exp(found["option_logits"]), probs, atol=1e-5)
    chosen = np.take_along_axis(np.asarray(probs), found["option"][:, None], axis=1)
    np.testing.assert_allclose(chosen[:, 0], probs.max(axis=1), rtol=1e-5)


def test_the_contract_says_what_a_caller_must_know():
    _, contract = export(policy_of("dac"), "stablehlo")
    assert contract.pop("versions").keys() == {"hitmdp_jax", "jax"}
    assert contract == {
        "schema": 2,
        "format": "stablehlo",
        "inputs": [
            {"name": "obs", "shape": ["batch", 4], "dtype": "float32"},
            {
                "name": "memory_previous",
                "shape": ["batch"],
                "dtype": "int32",
                "initial": 0,
                "drawn": False,
            },
            {
                "name": "memory_initial",
                "shape": ["batch"],
                "dtype": "bool",
                "initial": True,
                "drawn": False,
            },
        ],
        "outputs": [
            {"name": "action", "shape": ["batch", 1], "dtype": "float32"},
            {"name": "action_std", "shape": ["batch", 1], "dtype": "float32"},
            {"name": "option", "shape": ["batch"], "dtype": "int32"},
            {"name": "option_logits", "shape": ["batch", 4], "dtype": "float32"},
            {"name": "next_memory_previous", "shape": ["batch"], "dtype": "int32"},
            {"name": "next_memory_initial", "shape": ["batch"], "dtype": "bool"},
        ],
        "observation_names": [
            "slider position", "hinge angle", "slider velocity", "hinge velocity"
        ],
        "observation_parts": [["place", [1]], ["body", [3]]],
        "action_names": ["slide"],
        "action_range": [[-3.0], [3.0]],
        "actions_clipped": True,
        "control_step_seconds": 0.04,
        "option_count": 4,
    }  # fmt: skip


def test_a_memory_that_is_drawn_says_so():
    _, contract = export(policy_of("mopg"), "stablehlo")
    assert contract["inputs"][1]["drawn"]


def test_what_cannot_be_converted_is_explained():
    """Operations on whole numbers that jax2onnx does not know; StableHLO knows them all."""
    policy = policy_of("mopg")
    deep = policy.replace(agent=policy.agent.replace(value_order=2))
    with pytest.raises(UsageError, match=r"jax2onnx cannot convert this .*; format stablehlo can"):
        export(deep, "onnx")


def test_an_unknown_format_is_explained():
    with pytest.raises(UsageError, match="Unknown format 'onx'; did you mean 'onnx'"):
        export(policy_of("ppo"), "onx")


@pytest.mark.parametrize("format_name", FORMATS)
def test_a_policy_is_exported_under_x64_as_it_is_without(format_name):
    """There jax2onnx takes some numbers for 64 bits wide, and no runtime loads what it writes."""
    default, wide = (exported_under(enabled, format_name) for enabled in (False, True))
    assert wide == default


def exported_under(enabled, format_name):
    with jax.enable_x64(enabled):
        return export(policy_of("mopg"), format_name)
