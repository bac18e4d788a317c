import mujoco
import numpy as np
from mujoco import mjx

from hitmdp_jax.physics.constants import constants_of
from tests.programs import compiled

# A free body, from which a ball joint and two hinges hang, and a body that cannot move.
MODEL = """<mujoco><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body pos="0 0 -1"><geom size="0.2"/></body>
  <body pos="0 0 1"><freejoint/><geom type="box" size="0.1 0.2 0.3"/>
    <body pos="0.3 0 0"><joint type="ball" armature="0.1"/><geom size="0.1" pos="0.2 0.1 0"/>
      <body pos="0.4 0 0">
        <joint axis="0 1 0" armature="0.02"/><joint axis="1 0 0"/>
        <geom type="capsule" size="0.05 0.3" pos="0 0.1 0"/>
      </body></body></body></worldbody></mujoco>"""


def test_constants_of_drawn_masses_are_mujocos():
    model = mujoco.MjModel.from_xml_string(MODEL)
    factors = np.random.default_rng(0).uniform(0.5, 2.0, model.nbody)
    usual = mjx.put_model(model)
    model.body_mass[:] *= factors
    model.body_inertia[:] *= factors[:, None]

    @compiled
    def constants(mass, inertia):
        return constants_of(model, usual.replace(body_mass=mass, body_inertia=inertia))

    found = constants(np.float32(model.body_mass), np.float32(model.body_inertia))
    mujoco.mj_setConst(model, mujoco.MjData(model))
    for name, x in found.items():
        np.testing.assert_allclose(x, getattr(model, name), rtol=1e-3, atol=1e-5, err_msg=name)
