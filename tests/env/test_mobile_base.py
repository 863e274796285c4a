"""A robot that drives: large doors, contact, odometry, refusals."""

from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import gplfd_env
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.mobile_base import BASE_JOINTS, WHEEL_FORCE, WHEEL_LEVER, WHEELS
from gplfd_env.robot.model import OBSTACLES
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.robot.whole_body import SPEED
from gplfd_env.scene.build import build_scene

pytestmark = pytest.mark.slow

MOBILE = gplfd_env.MOBILE_ENVIRONMENT_ID
WALL = (*OBSTACLES, "wall_hinge", "wall_lock")
BESIDE = ("radial", "vertical")
ALL = (*BESIDE, "tangential")


def touching(env: Any) -> set[str]:
    """What of door and wall the robot's body touches."""
    geoms = {int(geom) for contact in env.data.contact for geom in contact.geom}
    return {env.model.geom(geom).name for geom in geoms} & set(WALL)


@pytest.mark.parametrize(
    ("door", "axes", "newtons", "least"),
    [
        ({"radius": 0.35, "handle_height": 0.85}, BESIDE, 2.5, 0.4),
        ({"radius": 0.65, "handle_height": 1.22}, BESIDE, 2.5, 0.4),
        ({"radius": 0.95, "handle_height": 1.05}, BESIDE, 2.5, 0.4),
        ({"preset": "room-584", "hinge_side": "right"}, ALL, 15.0, 0.2),
        ({"preset": "room-959", "hinge_side": "left"}, ALL, 15.0, 0.2),
    ],
)
def test_it_opens_to_a_right_angle_with_its_arm_as_it_was(
    door, axes, newtons, least, start_env, opening_poses
):
    env = start_env(door, base="mobile")
    places, forces, speeds = [], [], []
    for pose in opening_poses(env.door_geometry, 90.0, 6.0):
        *_, info = env.step(pose)
        places.append(env.data.qpos.copy())
        forces.append([info[f"force_{axis}"] for axis in axes])
        speeds.append(np.hypot(*info["base_velocity"][:2]))
        assert not touching(env)
        assert info["failure"] == ""
    assert np.degrees(info["door_angle"]) > 89.0
    arm = [env.model.joint(name).id for name in TIAGO_LIKE.arm]
    low, high = env.model.jnt_range[arm].T
    at = np.array(places)[:, env.model.jnt_qposadr[arm]]
    assert np.minimum(at - low, high - at).min() > least
    assert np.linalg.norm(forces, axis=1).max() < newtons
    assert info["slip"] < 2e-3
    assert 0.3 < max(speeds) < 0.75 * SPEED[0]
    side = -1.0 if env.door.hinge_side == "left" else 1.0
    assert side * info["base_pose"][2] == pytest.approx(np.pi / 2, abs=0.08)


def test_a_base_that_drives_into_the_door_is_blocked_by_it(start_env):
    """Towards the closed door, whose frame and leaf hold up against the drive."""
    env = start_env(id=MOBILE)
    env.model.geom("handle_bar").conaffinity = 0
    env.model.joint("hinge").range = 0.0, 1e-3
    into_door = np.array([*6 * [0.0], np.cos(0.4546), np.sin(0.4546), 0.0])
    for _ in range(400):
        observation, *_, info = env.step(into_door)
        if info["failure"] == "base_blocked":
            break
        env._episode.progress.opening.released = 0.0
    assert info["failure"] == "base_blocked"
    assert touching(env)
    assert np.hypot(*info["base_velocity"][:2]) < 0.5
    assert_array_equal(observation["base_pose"], info["base_pose"])
    stopped = info["base_pose"][:2]
    for _ in range(50):
        *_, info = env.step(into_door)
    # Its wheels slip, and it may turn along the door.
    assert_allclose(info["base_pose"][:2], stopped, atol=0.1)


def test_a_commanded_twist_is_driven_while_the_hand_stays(start_env):
    """Half a second backwards and to the right: the arm makes up for it."""
    env = start_env(id=MOBILE)
    for step in range(150):
        twist = [-0.1, -0.1, 0.1] if step < 50 else [0.0, 0.0, 0.0]
        observation, *_, info = env.step(np.array([*6 * [0.0], *twist]))
    assert -0.055 < info["base_pose"][0] < -0.04
    assert -0.055 < info["base_pose"][1] < -0.04
    assert info["base_pose"][2] == pytest.approx(0.05, abs=0.005)
    assert np.abs(observation["ee_pose"][:3]).max() < 1e-3
    assert_array_equal(observation["base_velocity"], info["base_velocity"])
    assert np.degrees(info["door_angle"]) < 0.2


def robot_mass(model: mujoco.MjModel) -> float:
    return float(model.body_subtreemass[model.body("base_footprint").id])


@pytest.mark.parametrize(("base", "bodies"), [("fixed", 0), ("mobile", 9)])
def test_what_the_robot_touches_is_solid_to_it_alone(base, bodies):
    model = build_scene(DoorConfig(), robot=TIAGO_LIKE.on(base))
    solid = {
        model.geom(index).name
        for index in range(model.ngeom)
        if model.geom_contype[index] or model.geom_conaffinity[index]
    }
    robot = {name for name in solid if name.endswith("_body")}
    pads = {"right_finger_pad", "left_finger_pad", "handle_bar"}
    assert solid == {*pads, *robot, *(WALL if base == "mobile" else ())}
    assert len(robot) == bodies
    assert robot_mass(model) == robot_mass(build_scene(DoorConfig()))


LIMIT = len(WHEELS) * WHEEL_FORCE


@pytest.fixture
def pushed(door_alone: Callable) -> Callable[..., np.ndarray]:
    """Return a function: how fast the resting base goes, pushed for 0.1 s [m/s, rad/s].

    Ahead, and about the vertical.
    """

    def push(force: float, torque: float = 0.0) -> np.ndarray:
        model, data = door_alone("mobile")
        data.body("base_link").xfrc_applied[[0, 5]] = force, torque
        mujoco.mj_step(model, data, nstep=50)
        return np.array([data.joint(name).qvel[0] for name in BASE_JOINTS])

    return push


def test_wheels_hold_the_base_up_to_the_torque_of_their_motors(pushed):
    """315 N and 147 N m, with less than a millimetre a second of creep.

    Beyond that they slip as with Coulomb friction: the base yields with what the wheels
    do not hold; it is not held by a servo.
    """
    assert pytest.approx(315.0, abs=0.1) == LIMIT
    assert np.abs(pushed(0.95 * LIMIT)).max() < 1e-3
    assert np.abs(pushed(0.0, 0.95 * LIMIT * WHEEL_LEVER)).max() < 1e-3
    # All of a wheel's force is spent once, on whatever it opposes.
    assert np.abs(pushed(0.45 * LIMIT, 0.45 * LIMIT * WHEEL_LEVER)).max() < 1e-3
    assert np.abs(pushed(0.65 * LIMIT, 0.65 * LIMIT * WHEEL_LEVER)).max() > 0.05
    mass = robot_mass(build_scene(DoorConfig(), robot=TIAGO_LIKE.on("mobile")))
    for force in (2.0 * LIMIT, 4.0 * LIMIT):
        ahead, *_ = pushed(force)
        # The arm, which hangs on springs, goes along in part.
        assert 0.9 < ahead / (0.1 * (force - LIMIT) / mass) < 1.5


def test_the_arm_pushes_its_base_through_the_wheels_alone(start_env):
    """The servo acts in the room's frame, but its motors sit between the links."""
    env = start_env("room-584", base="mobile")
    joints = [env.model.joint(name).dofadr[0] for name in BASE_JOINTS]
    for _ in range(20):
        env.step(env.action_space.high)
        assert np.abs(env.data.actuator_force).max() > 1000.0
        assert np.abs(env.data.qfrc_actuator[joints]).max() <= 1e-6


@pytest.mark.parametrize(
    ("field", "reached", "beyond"),
    [("radius", 0.65, 0.66), ("handle_height", 0.90, 0.91)],
)
def test_a_base_that_stands_refuses_what_it_cannot_reach(
    field, reached, beyond, make_env, make_vec
):
    """At make and at reset, drawn or not, one or many."""
    message = (
        rf'{field} = {beyond} is out of reach .*at most {reached:g} m; give base="'
    )
    far, near = {field: beyond}, {field: reached}
    for make in (make_env, partial(make_vec, 2)):
        env = make(door=near)
        env.reset(seed=0)
        for given in ({"door": far}, {"randomization": {field: (reached, beyond)}}):
            with pytest.raises(ValueError, match=message):
                make(**given)
            with pytest.raises(ValueError, match=message):
                env.reset(options=given)
            env.reset()
        assert make(door=far, base="mobile").reset(seed=0)
