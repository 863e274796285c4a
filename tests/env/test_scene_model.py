"""The compiled scene: everything named, the robot in it the one of the URDF."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gplfd_env.conventions.assets import asset_path
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.placement import ARM_JOINTS
from gplfd_env.robot.stance import BAR_STANCES
from gplfd_env.scene.build import GRASP_KEY, build_scene

NAMED = {
    "nbody": mujoco.mjtObj.mjOBJ_BODY,
    "njnt": mujoco.mjtObj.mjOBJ_JOINT,
    "ngeom": mujoco.mjtObj.mjOBJ_GEOM,
    "nsite": mujoco.mjtObj.mjOBJ_SITE,
    "ncam": mujoco.mjtObj.mjOBJ_CAMERA,
    "nlight": mujoco.mjtObj.mjOBJ_LIGHT,
    "ntex": mujoco.mjtObj.mjOBJ_TEXTURE,
    "nmat": mujoco.mjtObj.mjOBJ_MATERIAL,
    "npair": mujoco.mjtObj.mjOBJ_PAIR,
    "nexclude": mujoco.mjtObj.mjOBJ_EXCLUDE,
    "neq": mujoco.mjtObj.mjOBJ_EQUALITY,
    "ntendon": mujoco.mjtObj.mjOBJ_TENDON,
    "nactuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "nsensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "nkey": mujoco.mjtObj.mjOBJ_KEY,
}


@pytest.mark.parametrize(
    ("grasp", "base"), [("contact", "fixed"), ("weld", "fixed"), ("contact", "mobile")]
)
@pytest.mark.parametrize("count", NAMED)
def test_every_element_has_a_name(count: str, grasp: str, base: str) -> None:
    model = build_scene(DoorConfig(), grasp, base=base)
    names = [
        mujoco.mj_id2name(model, NAMED[count], index)
        for index in range(getattr(model, count))
    ]
    assert all(names), f"unnamed elements among {names}"
    assert len(set(names)) == len(names)


def test_scene_has_the_expected_parts() -> None:
    model = build_scene(DoorConfig())
    assert model.ncam >= 2
    assert (model.neq, model.nkey) == (1, 1)
    assert build_scene(DoorConfig(), "weld").neq == 2
    for limits, effort in zip(
        model.jnt_actfrcrange[1:8], (43, 43, 26, 26, 3, 6.6, 6.6), strict=True
    ):
        assert_allclose(limits, (-effort, effort))


@pytest.mark.parametrize("base", ["fixed", "mobile"])
def test_scene_keeps_the_urdf_bodies(base: str) -> None:
    alone = mujoco.MjModel.from_xml_path(str(asset_path("tiago_like.urdf")))
    scene = build_scene(DoorConfig(), base=base)
    for index in range(1, alone.nbody):
        name = alone.body(index).name
        for field in ("mass", "inertia", "ipos", "pos", "quat"):
            assert_allclose(
                getattr(scene.body(name), field), getattr(alone.body(name), field)
            )


def test_only_pads_and_bar_collide() -> None:
    model = build_scene(DoorConfig())
    active = {
        model.geom(index).name
        for index in range(model.ngeom)
        if model.geom_contype[index] or model.geom_conaffinity[index]
    }
    assert active == {"right_finger_pad", "left_finger_pad", "handle_bar"}


def test_scenes_are_the_caller_s_own() -> None:
    first, second = build_scene(DoorConfig()), build_scene(DoorConfig())
    first.opt.timestep = 1.0
    first.body_mass[:] = 0.0
    assert second.opt.timestep == 0.002
    assert build_scene(DoorConfig()).body_mass.sum() > 50


@settings(max_examples=12)
@pytest.mark.parametrize("base", ["fixed", "mobile"])
@given(share=st.floats(0, 1), up=st.floats(0, 1), handle_standoff=st.floats(0.06, 0.12))
def test_every_door_in_reach_can_be_held(
    base: str, share: float, up: float, handle_standoff: float
) -> None:
    """Hand on the closed handle, arm within limits, robot at rest."""
    door = DoorConfig(
        radius=0.30 + share * (BAR_STANCES[base, "pull"].radius - 0.30),
        handle_height=0.50 + up * (BAR_STANCES[base, "pull"].height - 0.50),
        handle_standoff=handle_standoff,
    )
    model = build_scene(door, base=base)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    mujoco.mj_forward(model, data)
    hand, frame = data.site("hand"), data.site("task_frame")
    assert_allclose(hand.xpos, frame.xpos, atol=2e-5)
    assert_allclose(hand.xmat, frame.xmat, atol=2e-4)
    arm = [model.joint(name).id for name in ARM_JOINTS]
    low, high = model.jnt_range[arm].T
    assert np.all((low < data.qpos[arm]) & (data.qpos[arm] < high))
    assert_allclose(data.sensor("hinge_angle").data, 0.0, atol=1e-4)
    for side in ("right", "left"):
        assert data.sensor(f"{side}_pad_contact").data > 0


def test_scene_frames_agree_with_the_task_s_words() -> None:
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
