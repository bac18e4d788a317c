import copy
import os
import pickle
import re

import jax
import mujoco
import numpy as np
import pytest

from hitmdp_jax import make_env
from hitmdp_jax.envs.assets import load_gymnasium_model
from hitmdp_jax.envs.base import MujocoEnv, SolverBudget
from hitmdp_jax.errors import UsageError
from hitmdp_jax.machine import available_cores
from hitmdp_jax.physics import (
    ENGINES,
    MjxEngine,
    NativeEngine,
    WarpEngine,
    find_engine,
    speed,
)
from hitmdp_jax.physics.base import CONTACTS

BUDGET = SolverBudget(iterations=3, ls_iterations=2, contacts=12)
NEWTON, PGS = int(mujoco.mjtSolver.mjSOL_NEWTON), int(mujoco.mjtSolver.mjSOL_PGS)
FALLING_BALL = """<mujoco><option integrator="{}"/><worldbody>
  <body><freejoint/><geom size="0.1"/></body>
  </worldbody></mujoco>"""
# Of two balls on a body one touches the floor, which turns the body; without friction, whose
# direction MJX chooses otherwise.
LANDING = """<mujoco><option integrator="{}"/><worldbody>
  <geom type="plane" size="1 1 1" condim="1"/>
  <body pos="0 0 0.09"><freejoint/>
    <geom size="0.1" condim="1"/><geom size="0.05" pos="0.2 0 0" contype="0" conaffinity="0"/>
  </body></worldbody></mujoco>"""
PUSHED_BALL = """<mujoco><worldbody>
  <body><freejoint name="free"/><geom size="0.1"/></body>
  </worldbody><actuator><motor joint="free" gear="1 0 0 0 0 0"/></actuator></mujoco>"""
MUSCLE = """<mujoco><worldbody>
  <body><joint name="hinge"/><geom size="0.1"/></body>
  </worldbody><actuator><general joint="hinge" dyntype="integrator"/></actuator></mujoco>"""


def falling_ball(integrator):
    return mujoco.MjModel.from_xml_string(FALLING_BALL.format(integrator))


@pytest.fixture
def ball():
    return falling_ball("Euler")


def solver_of(model):
    option, contacts = model.opt, model.numeric(CONTACTS).data[0]
    return option.solver, option.iterations, option.ls_iterations, contacts


@pytest.mark.parametrize("engine", ENGINES)
def test_current_fields_are_those_of_the_state_reached(engine):
    """A ball falls for 0.1 s and is pushed. Under x64, where actions that are clipped have 64 bits:
    MuJoCo C must read the memory that it is given as what it is."""
    ball = mujoco.MjModel.from_xml_string(PUSHED_BALL)
    with jax.enable_x64(True):
        physics = find_engine(engine).build(ball, 50, ("xpos",), current_fields=True)
        start = jax.jit(physics.initial)(ball.qpos0, np.zeros(ball.nv))
        after = jax.jit(physics.step)(start, np.array([20.0]))
        assert jax.tree.map(jax.typeof, after) == jax.tree.map(jax.typeof, start)
    data = mujoco.MjData(ball)
    data.ctrl[:] = 20.0
    mujoco.mj_step(ball, data, 50)
    mujoco.mj_forward(ball, data)
    assert data.qpos[0] > 0.02
    assert_state_is(after, data)
    np.testing.assert_allclose(after.displacement, after.qpos - start.qpos, atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("integrator", ["Euler", pytest.param("RK4", marks=pytest.mark.whole)])
def test_derived_fields_are_those_of_the_last_substep(engine, integrator):
    """With RK4, of its last stage; external forces are zero before any."""
    model = mujoco.MjModel.from_xml_string(LANDING.format(integrator))
    physics = find_engine(engine).build(model, 3, ("cfrc_ext", "xpos"))
    assert (physics.name, physics.frame_skip) == (engine, 3)
    data = mujoco.MjData(model)
    start = jax.jit(physics.initial)(data.qpos, data.qvel)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(start["xpos"], data.xpos, atol=1e-7)
    np.testing.assert_array_equal(start["cfrc_ext"], 0.0)
    after = jax.jit(physics.step)(start, start.ctrl)
    mujoco.mj_resetData(model, data)
    mujoco.mj_step(model, data, 3)
    mujoco.mj_rnePostConstraint(model, data)
    assert np.abs(data.cfrc_ext[1]).max() > 50.0
    np.testing.assert_allclose(after["cfrc_ext"], data.cfrc_ext, rtol=1e-3, atol=0.01)
    assert_state_is(after, data)


def assert_state_is(state, data):
    """A state, its positions of bodies among it, is that of MuJoCo C."""
    np.testing.assert_allclose(state.qpos, data.qpos, atol=1e-5)
    np.testing.assert_allclose(state.qvel, data.qvel, atol=1e-4)
    np.testing.assert_allclose(state["xpos"], data.xpos, atol=1e-5)
    assert not state.unstable


def test_mjx_gives_xla_what_every_device_compiles_and_computes_alike():
    """Full precision, where a GPU would round factors to ten bits; and no empty arrays.

    Empty constants crash the compiler of jaxlib 0.11 where a program is spread over devices.
    """
    env = make_env("ant", physics="mjx")  # of whose states some fields are derived
    state = jax.eval_shape(env.reset, jax.random.key(0))
    action = jax.ShapeDtypeStruct((env.action_size,), "float32")
    for program in (
        jax.jit(env.reset).lower(jax.random.key(0)),
        jax.jit(env.step).lower(state, action),
    ):
        lines = program.as_text().splitlines()
        products = [line for line in lines if "stablehlo.dot_general" in line]
        assert products
        assert all("precision = [HIGHEST, HIGHEST]" in line for line in products)
        constants = [line for line in lines if "stablehlo.constant" in line]
        assert constants
        assert not [line for line in constants if re.search(r"tensor<(\d+x)*0x", line)]


def test_mjx_takes_newton_for_pgs_and_the_task_budget():
    model = load_gymnasium_model("humanoid.xml")
    assert model.opt.solver == PGS
    MjxEngine().prepare(model, BUDGET)
    assert solver_of(model) == (NEWTON, *BUDGET)


def test_warp_takes_newton_for_pgs_and_keeps_the_models_own_budget():
    model = load_gymnasium_model("humanoid.xml")
    _, *own = solver_of(model)
    WarpEngine().prepare(model, BUDGET)
    assert solver_of(model) == (NEWTON, *own)


def test_mjx_keeps_the_models_own_budget_where_there_is_none_or_all_is_wanted():
    model = load_gymnasium_model("humanoid.xml")
    _, *own = solver_of(model)
    MjxEngine().prepare(model)
    assert solver_of(model) == (NEWTON, *own)
    MjxEngine(full_budget=True).prepare(model, BUDGET)
    assert solver_of(model) == (NEWTON, *own)


def test_native_leaves_the_model_as_it_is():
    model = load_gymnasium_model("humanoid.xml")
    before = solver_of(model)
    NativeEngine().prepare(model, BUDGET)
    assert solver_of(model) == before


@pytest.mark.parametrize("name", ["mjx", "native"])
def test_engine_is_prepared_for_alike_by_name_and_as_an_object(name):
    by_name, by_object = (make_env("humanoid", physics=x) for x in (name, type(ENGINES[name])()))
    assert solver_of(by_name.model) == solver_of(by_object.model)
    assert by_name.backend == by_object.backend == name


def test_preparing_leaves_the_callers_model_as_it_was():
    class Standing(MujocoEnv):
        sample_initial = observation = reward = lambda self, *_: None

    model = load_gymnasium_model("humanoid.xml")
    before = solver_of(model)
    env = Standing(model, 1, "mjx", mjx_budget=BUDGET)
    assert solver_of(env.model) == (NEWTON, *BUDGET)
    assert solver_of(model) == before


def test_names_find_engines_and_engines_find_themselves():
    for name, engine in ENGINES.items():
        assert engine.name == name
        assert find_engine(name) is engine
        assert find_engine(engine) is engine


@pytest.mark.parametrize("choice", ["natve", 3, None, ["mjx"], NativeEngine])
def test_what_is_no_engine_is_refused_in_a_sentence(choice):
    with pytest.raises(UsageError, match=r"^Unknown physics .* Valid: mjx, native, warp\.$"):
        find_engine(choice)


def test_devices_share_the_cores_that_the_process_may_use():
    cores = available_cores()
    assert NativeEngine().shared(1).num_threads == cores
    assert NativeEngine().shared(100 * cores).num_threads == 1
    assert NativeEngine(num_threads=8).shared(2).num_threads == 4
    for engine in (MjxEngine(), WarpEngine()):
        assert engine.shared(2) is engine


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs affinity")
def test_native_uses_only_the_cores_it_may_use(ball, monkeypatch):
    allowed = os.sched_getaffinity(0)
    threads = []

    class Spy(speed.Batch):
        def __init__(self, *arguments, **keywords):
            super().__init__(*arguments, **keywords)
            threads.append(self.nthread)

    monkeypatch.setattr(speed, "Batch", Spy)
    monkeypatch.setattr("hitmdp_jax.physics.pool.Batch", Spy)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        physics = NativeEngine().build(ball, 1)
        physics.step(physics.initial(ball.qpos0, np.zeros(ball.nv)), np.zeros(0, np.float32))
        speed.native_speed(ball, 1, seconds=0.0)
    finally:
        os.sched_setaffinity(0, allowed)
    assert threads == [1, 1]


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
)
@pytest.mark.parametrize("engine", ENGINES)
def test_tasks_of_every_engine_are_copied_and_pickled(engine, again):
    env = make_env("invertedpendulum", physics=engine, action_repeat=2)
    other = again(env)
    assert other is not env
    assert (other.backend, other.dt, other.action_size) == (engine, env.dt, env.action_size)
    if engine == NativeEngine.name:  # where more than JAX's own arrays is copied
        state = env.reset(jax.random.key(0))
        states = [e.step(state, np.ones(1, np.float32)) for e in (env, other)]
        np.testing.assert_array_equal(*(s.obs for s in states))


def test_negative_threads_are_refused():
    with pytest.raises(UsageError, match=r"num_threads = -1 must be a whole number from 0"):
        NativeEngine(num_threads=-1)


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
def test_every_engine_says_how_many_rows_are_safe_and_refuses_activations(engine):
    assert engine.safe_rows is None or engine.safe_rows > 0
    with pytest.raises(UsageError, match=r"actuator activations"):
        engine.check_task(mujoco.MjModel.from_xml_string(MUSCLE))


def test_missing_warp_is_explained_before_anything_is_made(monkeypatch):
    monkeypatch.setattr("mujoco.mjx.warp.WARP_INSTALLED", False)
    with pytest.raises(UsageError, match=r"needs the extra 'warp': install it with"):
        make_env("hopper", physics="warp")
