import mujoco
import pytest

from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.names import position_names, velocity_names
from hitmdp_jax.envs.spec import spec_of
from tests.examples.test_own_task import NAME as OWN_TASK
from tests.probes import Target

LEGS = ("bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot")


def test_the_cheetah_shows_its_coordinates():
    positions = ("rootx position", "rootz position", "rooty angle", *(f"{x} angle" for x in LEGS))
    velocities = tuple(f"{joint} velocity" for joint in ("rootx", "rootz", "rooty", *LEGS))
    spec = spec_of(make_env("halfcheetah", physics="native"))
    assert (spec.observation.names, spec.action.names) == (positions[1:] + velocities, LEGS)
    keywords = {"exclude_current_positions_from_observation": False}
    spec = spec_of(make_env("halfcheetah", physics="native", **keywords))
    assert spec.observation.names == positions + velocities


def test_sines_cosines_and_what_is_no_coordinate():
    spec = spec_of(make_env("reacher", physics="native"))
    assert spec.observation.names == (
        "cos(joint0 angle)", "cos(joint1 angle)", "sin(joint0 angle)", "sin(joint1 angle)",
        "target_x position", "target_y position", "joint0 velocity", "joint1 velocity",
        "obs[8]", "obs[9]",
    )  # fmt: skip
    assert spec.action.names == ("joint0", "joint1")  # nameless, and named by what they drive


def test_clipped_velocities_are_recognised():
    spec = spec_of(make_env("inverteddoublependulum", physics="native"))
    assert spec.observation.names == (
        "slider position", "sin(hinge angle)", "sin(hinge2 angle)", "cos(hinge angle)",
        "cos(hinge2 angle)", "slider velocity", "hinge velocity", "hinge2 velocity", "obs[8]",
    )  # fmt: skip


def test_free_joints_have_a_place_and_an_orientation():
    spec = spec_of(make_env("ant", physics="native"))
    assert spec.observation.names[:5] == (
        "root z position", "root orientation w", "root orientation x", "root orientation y",
        "root orientation z",
    )  # fmt: skip
    assert spec.observation.names[13:19] == (
        "root x velocity", "root y velocity", "root z velocity",
        "root x rotation", "root y rotation", "root z rotation",
    )  # fmt: skip
    assert spec.observation.names[27:] == tuple(f"obs[{i}]" for i in range(27, 105))  # forces


def test_joints_of_every_kind_have_as_many_names_as_coordinates():
    model = mujoco.MjModel.from_xml_string("""
    <mujoco> <worldbody> <body> <freejoint name="root"/> <geom size="1"/>
      <body> <joint type="ball"/> <geom size="1"/>
        <body> <joint name="knee"/> <joint name="rail" type="slide"/> <geom size="1"/> </body>
      </body> </body> </worldbody> </mujoco>""")
    positions, velocities = position_names(model), velocity_names(model)
    assert (len(positions), len(velocities)) == (model.nq, model.nv)
    assert positions[7:] == [
        *(f"joint 1 orientation {part}" for part in "wxyz"), "knee angle", "rail position",
    ]  # fmt: skip
    assert velocities[6:] == [
        *(f"joint 1 {axis} rotation" for axis in "xyz"), "knee velocity", "rail velocity",
    ]  # fmt: skip


@pytest.mark.parametrize("physics", ["native", "mjx"])
def test_a_task_of_ones_own_is_named_by_its_model(physics):
    spec = spec_of(make_env(OWN_TASK, physics=physics))
    expected = ("cos(hinge angle)", "sin(hinge angle)", "hinge velocity")
    assert (spec.observation.names, spec.action.names) == (expected, ("hinge",))


def test_a_task_without_a_model_has_numbers():
    spec = spec_of(Target())
    assert (spec.observation.names, spec.action.names) == (("obs[0]",), ("action[0]",))
