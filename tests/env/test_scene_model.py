"""The compiled scene: everything named, the robot of the URDF, what is only seen."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env.conventions.assets import asset_path
from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.doors.variation import Placement
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import GRASP_KEY, build_scene, build_spec
from gplfd_env.scene.door import CLOSER_ARM, GROUP, structure_of

WALLS = {"wall_hinge", "wall_lock"}

both_bases = pytest.mark.parametrize("base", ["fixed", "mobile"])


@both_bases
def test_scene_keeps_the_urdf_bodies(base):
    alone = mujoco.MjModel.from_xml_path(str(asset_path("tiago_like.urdf")))
    scene = build_scene(DoorConfig(), robot=TIAGO_LIKE.on(base))
    for index in range(1, alone.nbody):
        name = alone.body(index).name
        for field in ("mass", "inertia", "ipos", "pos", "quat"):
            in_scene = getattr(scene.body(name), field)
            assert_allclose(in_scene, getattr(alone.body(name), field))
    efforts = 43, 43, 26, 26, 3, 6.6, 6.6
    for joint, effort in zip(TIAGO_LIKE.arm, efforts, strict=True):
        limits = scene.jnt_actfrcrange[scene.joint(joint).id]
        assert_allclose(limits, (-effort, effort))


@settings(max_examples=12)
@both_bases
@given(share=st.floats(0, 1), up=st.floats(0, 1), handle_standoff=st.floats(0.06, 0.12))
def test_every_door_in_reach_can_be_held(base, share, up, handle_standoff):
    """Hand on the closed handle, arm within limits, robot at rest."""
    door = DoorConfig(
        radius=0.30 + share * (TIAGO_LIKE.on(base).stance(DoorConfig()).radius - 0.30),
        handle_height=0.50
        + up * (TIAGO_LIKE.on(base).stance(DoorConfig()).height - 0.50),
        leaf={"handle_standoff": handle_standoff},
    )
    model = build_scene(door, robot=TIAGO_LIKE.on(base))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    mujoco.mj_forward(model, data)
    hand, frame = data.site("hand"), data.site("task_frame")
    assert_allclose(hand.xpos, frame.xpos, atol=2e-5)
    assert_allclose(hand.xmat, frame.xmat, atol=2e-4)
    arm = [model.joint(name).id for name in TIAGO_LIKE.arm]
    low, high = model.jnt_range[arm].T
    assert np.all((low < data.qpos[arm]) & (data.qpos[arm] < high))
    assert_allclose(data.sensor("hinge_angle").data, 0.0, atol=1e-4)
    for side in ("right", "left"):
        assert data.sensor(f"{side}_pad_contact").data > 0


def test_scene_frames_agree_with_the_task_s_words():
    """Task frame at the closed handle: y up, x out of the door, hinge at z = -R."""
    door = DoorConfig(radius=0.4, handle_height=0.7)
    model = build_scene(door)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    frame = data.site("task_frame")
    x, y, z = frame.xmat.reshape(3, 3).T
    assert frame.xpos[2] == pytest.approx(0.7)
    assert_allclose(y, (0, 0, 1), atol=1e-12)
    assert_allclose(z, np.cross(x, y), atol=1e-12)
    assert_allclose(data.joint("hinge").xanchor, frame.xpos - 0.4 * z, atol=1e-12)
    assert_allclose(data.joint("hinge").xaxis, y, atol=1e-12)
    leaf_from_bar = data.geom("leaf").xpos - frame.xpos
    assert leaf_from_bar @ x == pytest.approx(-0.07), "the robot pulls towards +x"
    for name, side, edge in (
        ("leaf", -1, -0.4 - door.overhang),
        ("leaf", 1, door.leaf.backset),
        ("jamb_hinge", 1, -0.4 - door.overhang),
        ("jamb_lock", -1, door.leaf.backset),
    ):
        middle = (data.geom(name).xpos - frame.xpos) @ z
        assert middle + side * model.geom(name).size[2] == pytest.approx(edge, abs=0.01)


# --- What is only seen ---------------------------------------------------------------


@both_bases
@pytest.mark.parametrize("door", ["medium", "room-834", "heavy-fire"])
def test_a_scene_without_its_looks_weighs_and_touches_the_same(door, base):
    """Compiled again without them, every body has the same mass, bit for bit.

    The walls are solid only for a base that drives.
    """
    config = door_config(door)
    spec = build_spec(
        config,
        "contact",
        placement=Placement(),
        control="pose",
        structure=structure_of(config),
        robot=TIAGO_LIKE.on(base),
    )
    dressed = spec.compile()
    geoms = (dressed.geom(index) for index in range(dressed.ngeom))
    seen = {geom.name for geom in geoms if geom.group[0] == GROUP}
    seen |= WALLS if base == "fixed" else set()
    for geom in [one for one in spec.geoms if one.name in seen]:
        spec.delete(geom)
    for tendon in [one for one in spec.tendons if one.name == CLOSER_ARM]:
        spec.delete(tendon)
    bare = spec.compile()
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_M0"):
        assert_array_equal(getattr(dressed, field), getattr(bare, field))
    assert (dressed.nq, dressed.nv, dressed.nu) == (bare.nq, bare.nv, bare.nu)
    for name in seen:
        assert dressed.geom(name).contype == dressed.geom(name).conaffinity == 0
    assert dressed.ngeom - bare.ngeom == len(seen)
