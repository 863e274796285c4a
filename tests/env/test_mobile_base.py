"""A robot that drives: large doors, contact, odometry, refusals."""

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from numpy.testing import assert_allclose, assert_array_equal

import gplfd_env
from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.robot.collision import OBSTACLES
from gplfd_env.robot.mobile_base import BASE_JOINTS, WHEEL_FORCE, WHEEL_LEVER, WHEELS
from gplfd_env.robot.placement import ARM_JOINTS
from gplfd_env.robot.stance import BAR_STANCES, check_reach
from gplfd_env.robot.whole_body import SPEED
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_env.task.observation import Reader

pytestmark = pytest.mark.slow

MOBILE = gplfd_env.MOBILE_ENVIRONMENT_ID
WALL = (*OBSTACLES, "wall_hinge", "wall_lock")
AXES = ("tangential", "radial", "vertical")


def eased(share: float) -> float:
    s = min(max(share, 0.0), 1.0)
    return 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5


def touching(env: Any) -> set[str]:
    """What of door and wall the robot's body touches."""
    pairs = [
        [env.model.geom(geom).name for geom in contact.geom]
        for contact in env.data.contact
    ]
    return {name for pair in pairs for name in pair if name in WALL}


@pytest.mark.parametrize(
    ("radius", "height"), [(0.35, 0.85), (0.65, 1.22), (0.95, 1.05)]
)
def test_it_opens_to_a_right_angle_with_its_arm_as_it_was(
    radius: float, height: float, make_env: Callable, arc_commands: Callable
) -> None:
    door = {"radius": radius, "handle_height": height}
    env = make_env(door, base="mobile")
    env.reset(seed=0)
    arm = [env.model.joint(name).id for name in ARM_JOINTS]
    low, high = env.model.jnt_range[arm].T
    places = env.model.jnt_qposadr[arm]
    margins, forces, speeds = [], [], []
    for command in arc_commands(radius, degrees=90.0, duration=6.0)[:700]:
        *_, info = env.step(command)
        arm_at = env.data.qpos[places]
        margins.append(np.minimum(arm_at - low, high - arm_at).min())
        forces.append([info[f"force_{axis}"] for axis in ("radial", "vertical")])
        speeds.append(np.hypot(*info["base_velocity"][:2]))
        assert not touching(env)
        assert info["failure"] == ""
    assert np.degrees(info["door_angle"]) > 89.0
    assert min(margins) > 0.4
    assert np.abs(forces).max() < 2.5
    assert info["slip"] < 2e-3
    assert 0.3 < max(speeds) < 0.75 * SPEED[0]
    assert info["base_pose"][2] == pytest.approx(np.pi / 2, abs=0.08)


@pytest.mark.parametrize("base", ["fixed", "mobile"])
@pytest.mark.parametrize("name", ["small", "room-834"])
def test_the_torque_at_the_stop_is_what_presses_the_leaf_against_it(
    name: str, base: Base
) -> None:
    door = DOORS[name]
    model = build_scene(door, base=base)
    model.geom("handle_bar").conaffinity = 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    data.joint("hinge").qpos = door.stop_angle
    data.joint("hinge").qfrc_applied = 50.0
    mujoco.mj_step(model, data, nstep=500)
    reader = Reader.of("contact", "pose", base, door.handle, door.swing)
    reading = reader.door_reading(data.sensordata.tolist())
    assert reading.angle == pytest.approx(door.stop_angle, abs=2e-3)
    assert reading.stop_torque == pytest.approx(50.0, rel=0.03)
    assert reading.handle_angle == pytest.approx(0.0, abs=0.01)


def worked(door: DoorGeometry, degrees: float) -> Iterator[np.ndarray]:
    """Lever pressed in 0.8 s, let back between 8° and 25°, opened in 6 s."""
    for step in range(760):
        angle = np.radians(degrees) * eased((0.01 * step - 0.8) / 6.0)
        back = eased((np.degrees(angle) - 8.0) / 17.0)
        turn = door.travel * eased(0.01 * step / 0.8) * (1.0 - back)
        yield door.hand_poses(angle, turn)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("preset", ["room-709", "room-959"])
def test_it_goes_through_the_frame_of_doors_of_rooms(
    preset: str, side: str, make_env: Callable
) -> None:
    door = {"preset": preset, "hinge_side": side, "swing": "push"}
    env = make_env(door, base="mobile")
    env.reset(seed=0)
    for pose in worked(env.door_geometry, 67.0):
        *_, terminated, _, info = env.step(pose)
        assert not touching(env)
        if terminated:
            break
    assert info["stage"] == "held"


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("preset", ["room-584", "room-959"])
def test_it_opens_doors_of_rooms_to_a_right_angle(
    preset: str, side: str, make_env: Callable
) -> None:
    env = make_env({"preset": preset, "hinge_side": side}, base="mobile")
    env.reset(seed=0)
    arm = [env.model.joint(name).id for name in ARM_JOINTS]
    low, high = env.model.jnt_range[arm].T
    margins, forces = [], []
    for pose in worked(env.door_geometry, 90.0):
        *_, info = env.step(pose)
        forces.append([info[f"force_{a}"] for a in AXES])
        arm_at = env.data.qpos[env.model.jnt_qposadr[arm]]
        margins.append(np.minimum(arm_at - low, high - arm_at).min())
        assert not touching(env)
        assert info["failure"] == ""
    assert np.degrees(info["door_angle"]) > 89.0
    assert min(margins) > 0.2
    assert np.linalg.norm(forces, axis=1).max() < 15.0
    assert info["slip"] < 2e-3


@pytest.mark.parametrize("radius", [0.35, 0.65, 0.9])
def test_it_goes_after_a_hand_that_pushes_through_the_frame(
    radius: float, make_env: Callable, arc_commands: Callable
) -> None:
    """To 60° along a pushed handle's arc, whose leaf is not there."""
    env = make_env(radius, base="mobile")
    env.reset(seed=0)
    for geom in ("handle_bar", "leaf"):
        env.model.geom(geom).conaffinity = 0
    pushed = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
    for command in pushed * arc_commands(radius, degrees=60.0, duration=6.0)[:700]:
        observation, *_, info = env.step(command)
        assert info["failure"] in ("", "grasp_lost", "stalled")
    assert_allclose(observation["ee_pose"], command, atol=0.02)
    arm = [env.model.joint(name).id for name in ARM_JOINTS]
    low, high = env.model.jnt_range[arm].T
    arm_at = env.data.qpos[env.model.jnt_qposadr[arm]]
    assert np.minimum(arm_at - low, high - arm_at).min() > 0.05


def test_small_motions_are_left_to_the_arm(make_env: Callable) -> None:
    env = make_env(base="mobile", grasp="weld")
    env.reset(seed=0)
    for step in range(300):
        turn = 2 * np.pi * step * 0.01
        *_, info = env.step(0.01 * np.sin(turn) * np.array([1, 0, 1, 0, 2, 0]))
        assert np.abs(info["base_pose"]).max() < 1e-3


def test_a_base_that_drives_into_the_door_is_blocked_by_it(make_env: Callable) -> None:
    """Towards the closed door, whose frame and leaf hold up against the drive."""
    env = make_env(id=MOBILE)
    env.reset(seed=0)
    env.model.geom("handle_bar").conaffinity = 0
    env.model.joint("hinge").range = 0.0, 1e-3
    into_door = [np.cos(0.4546), np.sin(0.4546), 0.0]
    for _ in range(400):
        observation, *_, info = env.step(np.array([*6 * [0.0], *into_door]))
        if info["failure"] == "base_blocked":
            break
        env._episode.progress.opening.released = 0.0
    assert info["failure"] == "base_blocked"
    assert touching(env)
    assert np.hypot(*info["base_velocity"][:2]) < 0.5
    assert_array_equal(observation["base_pose"], info["base_pose"])
    stopped = info["base_pose"][:2]
    for _ in range(50):
        *_, info = env.step(np.array([*6 * [0.0], *into_door]))
    # Its wheels slip, and it may turn along the door.
    assert_allclose(info["base_pose"][:2], stopped, atol=0.1)


def test_a_commanded_twist_is_driven_while_the_hand_stays(make_env: Callable) -> None:
    """Half a second backwards and to the right: the arm makes up for it."""
    env = make_env(id=MOBILE)
    env.reset(seed=0)
    for step in range(150):
        twist = [-0.1, -0.1, 0.1] if step < 50 else [0.0, 0.0, 0.0]
        observation, *_, info = env.step(np.array([*6 * [0.0], *twist]))
    assert -0.055 < info["base_pose"][0] < -0.04
    assert -0.055 < info["base_pose"][1] < -0.04
    assert info["base_pose"][2] == pytest.approx(0.05, abs=0.005)
    assert np.abs(observation["ee_pose"][:3]).max() < 1e-3
    assert_array_equal(observation["base_velocity"], info["base_velocity"])
    assert np.degrees(info["door_angle"]) < 0.2


def test_pose_of_the_base_is_where_its_body_is(
    make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env(0.9, base="mobile")
    env.reset(seed=0)
    for command in arc_commands(0.9, duration=4.0)[:250]:
        *_, info = env.step(command)
    mujoco.mj_kinematics(env.model, env.data)
    body = env.data.body("base_footprint")
    # What is sensed is one physics step old.
    assert_allclose(body.xpos[:2], info["base_pose"][:2], atol=2e-3)
    assert body.xpos[2] == 0.0
    turned = np.arctan2(body.xmat[3], body.xmat[0])
    assert turned == pytest.approx(info["base_pose"][2], abs=2e-3)
    assert info["base_pose"][2] > 0.3


def test_a_fixed_base_says_that_it_stands(make_env: Callable) -> None:
    env = make_env()
    _, info = env.reset(seed=0)
    *_, stepped = env.step(np.full(6, 0.01))
    for one in (info, stepped):
        assert_array_equal(one["base_pose"], np.zeros(3))
        assert_array_equal(one["base_velocity"], np.zeros(3))
    names = [env.model.joint(index).name for index in range(env.model.njnt)]
    assert not set(BASE_JOINTS) & set(names)


def test_what_the_robot_touches_is_solid_to_it_alone() -> None:
    model = build_scene(DoorConfig(), base="mobile")
    solid = {
        model.geom(index).name
        for index in range(model.ngeom)
        if model.geom_contype[index] or model.geom_conaffinity[index]
    }
    bodies = {name for name in solid if name.endswith("_body")}
    pads = {"right_finger_pad", "left_finger_pad", "handle_bar"}
    assert solid == {*pads, *bodies, *WALL}
    assert len(bodies) == 9
    fixed = build_scene(DoorConfig())
    assert robot_mass(fixed) == robot_mass(model)


def robot_mass(model: mujoco.MjModel) -> float:
    return float(model.body_subtreemass[model.body("base_footprint").id])


LIMIT = len(WHEELS) * WHEEL_FORCE


def pushed(force: float, torque: float = 0.0) -> np.ndarray:
    """Return how fast the resting base goes, pushed ahead for 0.1 s [m/s, rad/s]."""
    model = build_scene(DoorConfig(), base="mobile")
    model.geom("handle_bar").conaffinity = 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    base = data.body("base_link")
    base.xfrc_applied[[0, 5]] = force, torque
    mujoco.mj_step(model, data, nstep=50)
    return np.array([data.joint(name).qvel[0] for name in BASE_JOINTS])


def test_wheels_hold_the_base_up_to_the_torque_of_their_motors() -> None:
    """315 N and 147 N m, with less than a millimetre a second of creep."""
    assert pytest.approx(315.0, abs=0.1) == LIMIT
    assert np.abs(pushed(0.95 * LIMIT)).max() < 1e-3
    assert np.abs(pushed(0.0, 0.95 * LIMIT * WHEEL_LEVER)).max() < 1e-3
    # All of a wheel's force is spent once, on whatever it opposes.
    assert np.abs(pushed(0.45 * LIMIT, 0.45 * LIMIT * WHEEL_LEVER)).max() < 1e-3
    assert np.abs(pushed(0.65 * LIMIT, 0.65 * LIMIT * WHEEL_LEVER)).max() > 0.05


def test_beyond_that_they_slip_as_with_coulomb_friction() -> None:
    """The base yields with what the wheels do not hold; it is not held by a servo."""
    mass = robot_mass(build_scene(DoorConfig(), base="mobile"))
    for force in (2.0 * LIMIT, 4.0 * LIMIT):
        ahead, *_ = pushed(force)
        # The arm, which hangs on springs, goes along in part.
        assert 0.9 < ahead / (0.1 * (force - LIMIT) / mass) < 1.5


def test_the_arm_pushes_its_base_through_the_wheels_alone(make_env: Callable) -> None:
    """The servo acts in the room's frame, but its motors sit between the links."""
    env = make_env("room-584", base="mobile")
    env.reset(seed=0)
    joints = [env.model.joint(name).dofadr[0] for name in BASE_JOINTS]
    for _ in range(20):
        env.step(env.action_space.high)
        assert np.abs(env.data.actuator_force).max() > 1000.0
        assert np.abs(env.data.qfrc_actuator[joints]).max() <= 1e-6


def test_a_commanded_base_obeys_its_drive_and_opens_no_latch(
    make_env: Callable,
) -> None:
    """Once 82 rad/s, and the door open by 104° within 0.29 s, its handle unturned."""
    env = make_env("room-584", base="mobile")
    env.reset(seed=0)
    turn, turned = np.pi / 2, 0.0
    for step in range(100):
        *_, info = env.step(np.array([1.0, 1.0, 1.0, -turn, turn, turn]))
        assert np.hypot(*info["base_velocity"][:2]) < 1.01 * SPEED[0]
        assert abs(info["base_velocity"][2]) < 1.01 * SPEED[1]
        turned = max(turned, info["handle_angle"])
        assert np.degrees(info["door_angle"]) < 1.0 or turned > 0.5
        assert step > 28 or np.degrees(info["door_angle"]) < 1.0


def test_a_base_that_is_led_a_metre_away_keeps_to_its_speed(make_env: Callable) -> None:
    """Once 2.6 m/s."""
    env = make_env(base="mobile")
    env.reset(seed=0)
    speeds = []
    for _ in range(150):
        *_, info = env.step(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        speeds.append(np.hypot(*info["base_velocity"][:2]))
    assert 0.5 < max(speeds) < 1.01 * SPEED[0]


@pytest.mark.parametrize(
    ("id", "disturbance"),
    [
        (gplfd_env.ENVIRONMENT_ID, "bump"),
        (gplfd_env.IMPEDANCE_ENVIRONMENT_ID, "none"),
        (gplfd_env.GRIPPER_ENVIRONMENT_ID, "none"),
        (MOBILE, "bump"),
    ],
)
def test_actions_beyond_the_bounds_are_those_at_the_bounds(
    id: str, disturbance: str, make_env: Callable, make_vec: Callable
) -> None:
    """Of one and of many, also where squares of numbers overflow."""
    shared = {"id": id, "base": "mobile", "disturbance": disturbance}
    space = make_env(**shared).action_space
    low, high = space.low, space.high
    mixed = np.where(np.arange(len(high)) % 2 == 0, high, low)
    for beyond in (
        np.full(len(high), 1e200),
        np.full(len(high), 1e10),
        mixed + 1e10 * np.sign(mixed),
    ):
        bound = np.clip(beyond, low, high)
        one, other = make_env(**shared), make_env(**shared)
        many = make_vec(2, **shared)
        for each in (one, other, many):
            each.reset(seed=0)
        for _ in range(20):
            expected = one.step(bound)
            assert data_equivalence(expected[0], other.step(beyond)[0], exact=True)
            observations, *_, infos = many.step(np.stack([beyond, bound]))
            assert_array_equal(observations["ee_pose"][0], expected[0]["ee_pose"])
            assert_array_equal(infos["base_pose"][0], expected[-1]["base_pose"])


@pytest.mark.parametrize(
    ("field", "reached", "beyond"),
    [("radius", 0.65, 0.66), ("handle_height", 0.90, 0.91)],
)
def test_a_base_that_stands_refuses_what_it_cannot_reach(
    field: str, reached: float, beyond: float, make_env: Callable, make_vec: Callable
) -> None:
    """At make and at reset, drawn or not, one or many; the record allows it."""
    message = (
        rf'{field} = {beyond} is out of reach .*at most {reached:g} m; give base="'
    )
    far, near = {field: beyond}, {field: reached}
    drawn = {field: (reached, beyond)}
    for make in (make_env, lambda **given: make_vec(2, **given)):
        for given in ({"door": far}, {"randomization": drawn}):
            with pytest.raises(ValueError, match=message):
                make(**given)
            env = make(door=near)
            env.reset(seed=0)
            with pytest.raises(ValueError, match=message):
                env.reset(options=given)
            env.reset()
            check_reach(DoorConfig(**near), "fixed")
        assert make(door=far, base="mobile").reset(seed=0)


def test_the_record_ends_where_the_driving_robot_s_reach_does() -> None:
    most = {"radius": BAR_STANCES["mobile", "pull"].radius, "handle_height": 1.22}
    check_reach(DoorConfig(**most), "mobile")
    for field, value in most.items():
        with pytest.raises(ValueError, match=f"{field} = "):
            DoorConfig(**{field: value + 0.01})


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_wrong_base_is_told_what_there_is(make: Callable) -> None:
    with pytest.raises(ValueError, match="base = 'wheels' is not one of 'fixed', 'mob"):
        make(gplfd_env.ENVIRONMENT_ID, base="wheels")
    with pytest.raises(ValueError, match="base = 'fixed' is not one of 'mobile'"):
        make(MOBILE, base="fixed")


@pytest.mark.parametrize(
    "id", [gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID]
)
@pytest.mark.parametrize("arguments", [{}, {"disturbance": "bump", "grasp": "weld"}])
def test_checker_accepts_a_base_that_drives(
    id: str, arguments: dict[str, Any], make_env: Callable
) -> None:
    env = make_env(0.9, id=id, base="mobile", **arguments)
    with pytest.warns(UserWarning, match="symmetric and normalized"):
        check_env(env, skip_render_check=True)


def test_random_actions_break_nothing(make_vec: Callable) -> None:
    """2,000 steps of doors in the whole range, hands and bases anywhere."""
    envs = make_vec(
        4,
        id=MOBILE,
        randomization={
            "preset": "hard",
            "radius": (0.30, 0.95),
            "handle_height": (0.60, 1.10),
        },
        max_episode_steps=100,
    )
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    low, high = envs.single_action_space.low, envs.single_action_space.high
    pull = np.zeros(9)
    for step in range(500):
        if step % 20 == 0:
            pull = rng.uniform(0.3 * low, 0.3 * high, (4, 9))
        observations, rewards, _, _, infos = envs.step(pull)
        assert not infos["simulation_error"].any()
        assert all(np.isfinite(value).all() for value in observations.values())
        assert np.isfinite(rewards).all()
        assert envs.single_observation_space.contains(
            {name: value[0] for name, value in observations.items()}
        )
