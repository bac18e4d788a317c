import mujoco
import numpy as np
import pytest

from hitmdp_jax.envs.assets import can_touch, load_gymnasium_model, load_model
from hitmdp_jax.errors import UsageError

FILES = {
    "inverted_pendulum.xml": False,
    "inverted_double_pendulum.xml": False,
    "reacher.xml": False,
    "swimmer.xml": False,
    "half_cheetah.xml": True,
    "hopper.xml": True,
    "walker2d.xml": True,
    "ant.xml": True,
    "humanoid.xml": True,
    "humanoidstandup.xml": True,
}


@pytest.mark.parametrize("filename", FILES)
def test_models_without_contacts_are_recognised(filename):
    model = load_gymnasium_model(filename)
    assert can_touch(model) == FILES[filename]
    switched_off = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT)
    assert switched_off != FILES[filename]


@pytest.mark.parametrize("filename", FILES)
def test_the_simulation_is_the_files_own_to_the_bit(filename):
    ours, theirs = load_gymnasium_model(filename), load_gymnasium_model(filename)
    theirs.opt.disableflags = 0
    ends = []
    for model in (ours, theirs):
        data = mujoco.MjData(model)
        for ctrl in np.random.default_rng(0).uniform(-1, 1, (500, model.nu)):
            data.ctrl[:] = ctrl
            mujoco.mj_step(model, data)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    np.testing.assert_array_equal(*ends)


def test_pairs_named_in_the_file_count():
    xml = """<mujoco><worldbody>
      <geom name="a" type="plane" size="1 1 1" contype="0" conaffinity="0"/>
      <body><freejoint/><geom name="b" size="1" contype="0" conaffinity="0"/></body>
      </worldbody>{}</mujoco>"""
    pair = '<contact><pair geom1="a" geom2="b"/></contact>'
    assert not can_touch(mujoco.MjModel.from_xml_string(xml.format("")))
    assert can_touch(mujoco.MjModel.from_xml_string(xml.format(pair)))


def test_a_model_comes_from_a_file_or_from_its_text(tmp_path):
    xml = """
      <mujoco><worldbody><body><freejoint/><geom size="1"/></body></worldbody></mujoco>"""
    file = tmp_path / "ball.xml"
    file.write_text(xml.strip())
    assert load_model(xml).nv == load_model(file).nv == load_model(str(file)).nv == 6
    with pytest.raises(UsageError, match=r"There is no model file '.*bal\.xml'"):
        load_model(tmp_path / "bal.xml")
