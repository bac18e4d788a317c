"""docs/extending.md: the code of the page is read out of it, trained, saved, loaded and scored."""

import dataclasses
import importlib.util
import inspect
import json
import re
import shlex
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hitmdp_jax
from hitmdp_jax import __main__ as command
from hitmdp_jax import metrics, physics
from hitmdp_jax.agents import Agent
from hitmdp_jax.cli import tasks
from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs import suites
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.figures import catalogue, registry
from hitmdp_jax.figures.curves import read_metrics
from hitmdp_jax.runs import loop, sinks
from hitmdp_jax.runs.callbacks import own_code
from hitmdp_jax.runs.claim import claim
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.run import Run

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text()
FILES = dict(re.findall(r"^```python\n# (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
TINY = "num_envs=4 rollout_length=16 algo.width=8 total_steps=4096 report=false"


def module_of(path, name):
    """Import a file under a name of the package's, as if it lay there."""
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def metric_of_the_page():
    (entry,) = re.findall(r"`(\"\w+\": Metric\(.*?\)),`", PAGE)
    return eval(f"{{{entry}}}", {"Metric": metrics.Metric})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with every file that the page has, under its last name."""
    folder = tmp_path_factory.mktemp("page")
    for name, code in FILES.items():
        (folder / Path(name).name).write_text(code)
    return folder


@pytest.fixture(scope="module")
def run_dir(folder):
    """What the page's last command leaves, trained small, with the page's sink besides."""
    (line,) = re.findall(r"`hitmdp train (.*? callbacks=.*?)`", PAGE)
    jsonl = module_of(folder / "jsonl.py", "hitmdp_jax.runs.sinks.jsonl")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sinks, "SINKS", (*sinks.SINKS, jsonl.JsonLines))
        patch.setattr(metrics, "VOCABULARY", metrics.VOCABULARY | metric_of_the_page())
        config = Settings([*shlex.split(line), "seeds=2", "seed=5", *TINY.split()]).config()
        loop.run(Run.create(config), claim(None, config), hooks=own_code(config))
    (run_dir,) = (folder / "runs" / "puck.Puck" / "reinforce.Reinforce").iterdir()
    return run_dir


def test_the_task_and_the_algorithm_are_short():
    assert max(len(FILES[name].splitlines()) for name in ("puck.py", "reinforce.py")) < 60
    assert len(PAGE.splitlines()) <= 250


def test_the_task_moves_as_its_comments_say(folder):
    env = hitmdp_jax.make_env(f"{folder}/puck.py:Puck", friction=0.0)
    state = env.reset(jax.random.key(0)).replace(obs=jnp.array([0.5, 0.0]))
    for _ in range(2):  # from rest: v = 0.2, 0.4; x = 0.5 + 0.02 + 0.04
        state = env.step(state, 2)
    np.testing.assert_allclose(state.obs, [0.56, 0.4], rtol=1e-6)
    np.testing.assert_allclose(state.reward, -0.56, rtol=1e-6)
    assert not state.done
    assert env.step(state.replace(obs=jnp.array([2.99, 1.0])), 1).done


def test_what_was_trained_is_loaded_and_acts(folder, run_dir):
    policy = hitmdp_jax.load(run_dir, seed=6)
    env = hitmdp_jax.make_env(f"{folder}/puck.py:Puck", friction=0.2)
    assert policy.spec == env.spec
    memory = policy.initial_memory(jax.random.key(0))
    obs = env.reset(jax.random.key(0)).obs
    action, _ = policy.act(obs, memory, jax.random.key(0), deterministic=True)
    likeliest = policy.agent.policy(policy.params, policy.normalized(obs)).probs.argmax()
    assert action == likeliest


def test_the_callback_sees_a_training_from_python(folder):
    env = hitmdp_jax.make_env(f"{folder}/puck.py:Puck")
    agent = module_of(folder / "reinforce.py", "reinforce").Reinforce()
    callback = module_of(folder / "norm.py", "norm").ParameterNorm()
    key = jax.random.key(0)
    state, seen = hitmdp_jax.train(agent, env, key, num_steps=10_000, callbacks=[callback])
    norms = seen["parameter_norm"]
    assert np.isnan(norms[::2]).all()  # it is called every 4096 steps, after two iterations
    assert (norms[1::2] > 0).all()
    assert int(state.iteration) == len(norms) == 5


def test_what_was_trained_is_scored(run_dir, monkeypatch, capsys):
    scored = re.search(r"^python -m hitmdp_jax (evaluate .*)$", PAGE, re.MULTILINE)[1]
    arguments = scored.replace("20", "4").replace("RUN_DIR", str(run_dir)).split()
    monkeypatch.setattr(sys, "argv", ["hitmdp", *arguments, "--json"])
    command.main()
    scores = json.loads(capsys.readouterr().out)
    assert [row["seed"] for row in scores] == [5, 6]
    assert all(-150 < row["return"] < 0 for row in scores)  # 50 steps of at most 3 m


def test_the_commands_settings_reach_the_task_and_the_algorithm(folder, monkeypatch):
    monkeypatch.chdir(folder)
    line = re.search(r"^python train\.py (env=puck.*)$", PAGE, re.MULTILINE)[1]
    config = Settings(line.split()).config()
    assert (config.env["friction"], config.make_agent().gamma, config.seeds) == (0.2, 0.95, 2)


@pytest.fixture
def ice(tmp_path, monkeypatch):
    """The page's suite below its task, in the package, with its name in the table."""
    whole = "\n\n".join([FILES["puck.py"], FILES["envs/suites/ice.py"]])
    (tmp_path / "ice.py").write_text(whole)
    monkeypatch.setattr(suites, "__path__", [*suites.__path__, str(tmp_path)])
    monkeypatch.setattr(suites, "SUITES", (*suites.SUITES, "ice"))
    caches = suites.all_suites, tasks.store_tasks
    for cache in caches:
        cache.cache_clear()
    yield
    sys.modules.pop("hitmdp_jax.envs.suites.ice", None)
    for cache in caches:
        cache.cache_clear()


def test_the_suite_is_one_file_and_a_name(ice):
    assert Settings(["env=ice/puck", "env.friction=2"]).config().env["friction"] == 2
    assert hitmdp_jax.make_env("ice/puck", friction=2.0).friction == 2
    with pytest.raises(hitmdp_jax.UsageError, match="did you mean 'ice/puck'"):
        hitmdp_jax.make_env("ice/puk")


def test_the_figure_is_found_and_drawn_of_the_run(folder, run_dir, monkeypatch):
    own = folder / "figures"
    own.mkdir()
    (own / "gradients.py").write_text(FILES["figures/catalogue/gradients.py"])
    monkeypatch.setattr(catalogue, "__path__", [*catalogue.__path__, str(own)])
    assert registry.summaries()["gradients"] == "How long the gradient is while an agent learns."
    assert registry.find("gradients").title == "The gradient"
    run = registry.RunMetrics("a run", read_metrics(run_dir), "")
    with pytest.raises(hitmdp_jax.UsageError, match="no gradient_norm"):
        registry.find("gradients").draw(run._replace(metrics={}))
    (axes,) = registry.find("gradients").draw(run).axes
    steps, values = axes.lines[1].get_data()
    np.testing.assert_array_equal(steps, [2048, 4096])
    np.testing.assert_array_equal(values, run.metrics["gradient_norm"][1])


def test_the_metric_is_known_and_a_report_has_its_last_value(monkeypatch):
    ((name, metric),) = metric_of_the_page().items()
    values = {name: jnp.array([1.0, 2.0, 6.0])}
    assert metrics.over_iterations(values)[name] == 3
    monkeypatch.setitem(metrics.VOCABULARY, name, metric)
    assert metrics.over_iterations(values)[name] == 6
    assert metrics.describe(name).meaning == metric.meaning


def test_the_sink_has_a_line_for_every_report(run_dir):
    lines = [json.loads(line) for line in (run_dir / "metrics.jsonl").read_text().splitlines()]
    assert [line["env_steps"] for line in lines] == [2048, 4096]
    rows = read_metrics(run_dir)
    seen = [line["gradient_norm"] for line in lines]
    np.testing.assert_allclose(seen, rows["gradient_norm"].T, rtol=1e-4)


def test_the_engine_is_mujoco_with_the_moons_gravity(folder, monkeypatch):
    moon = module_of(folder / "moon.py", "hitmdp_jax.physics.moon").MoonEngine()
    monkeypatch.setitem(physics.ENGINES, "moon", moon)
    assert Settings(["physics=moon"]).config().physics == "moon"
    env = hitmdp_jax.make_env("hopper", physics="moon")
    assert env.model.opt.gravity[2] == -1.62
    state = env.reset_to(env.model.qpos0 + np.eye(env.model.nq)[1], np.zeros(env.model.nv))
    state = jax.jit(env.step)(state, np.zeros(3))  # a metre above the floor: it falls freely
    np.testing.assert_allclose(state.pipeline_state.qvel[1], -1.62 * env.dt, rtol=1e-2)


def test_the_callback_reports_when_it_is_due(run_dir):
    found = read_metrics(run_dir)["parameter_norm"]
    assert np.isnan(found[:, 0]).all()  # due every 4096 steps
    for seed, norm in zip((5, 6), found[:, 1], strict=True):
        leaves = jax.tree.leaves(hitmdp_jax.load(run_dir, seed).params)
        np.testing.assert_allclose(norm, np.sqrt(sum((x**2).sum() for x in leaves)), rtol=1e-4)


def rows_of(head):
    table = re.search(rf"^\| {head} \|.*?\n\n", PAGE, re.MULTILINE | re.DOTALL)[0]
    return {name for cell in re.findall(r"^\| (.*?) \|", table, re.MULTILINE)[2:]
            for name in re.findall(r"`([\w.]+)", cell)}  # fmt: skip


def test_the_tables_name_what_there_is():
    methods = {name: inspect.signature(x) for name, x in vars(Agent).items() if callable(x)}
    named = rows_of("method of an agent")
    others = {"replace", "bind", "traced_values"}  # which are no algorithm's to define
    assert named == {name for name in methods if not name.startswith("_")} - others
    for name, arguments in re.findall(r"`(\w+)\((.*?)\)`", PAGE.split("| method of")[1]):
        if name in methods:
            assert arguments.split(", ") == list(methods[name].parameters)[1:], name
    parts = {name.split(".")[1] for name in rows_of("part of a task") if name.startswith("spec.")}
    assert parts == {field.name for field in dataclasses.fields(Spec)}
    assert {"reset", "step", "state.obs", "state.info"} <= rows_of("part of a task")


def test_the_run_is_a_run_like_any_other(run_dir):
    config = RunConfig.load(run_dir)
    assert config.title == "reinforce.Reinforce on puck.Puck"
    assert config.seeds == 2
