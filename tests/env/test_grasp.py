"""The friction grasp: it opens doors, holds 20 N, and keeps a closed door closed."""

from collections.abc import Callable

import numpy as np
import pytest

from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.robot.model import SERVO_STIFFNESS
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.task.observation import Reader

pytestmark = pytest.mark.slow

FORCES = ("force_tangential", "force_vertical", "force_radial")

# Task frame: x pulls the door open, y is up, z points away from the hinge.
DIRECTIONS = {
    "pull": (1, 0, 0),
    "push": (-1, 0, 0),
    "away from the hinge": (0, 0, 1),
    "towards the hinge": (0, 0, -1),
    "up": (0, 1, 0),
    "down": (0, -1, 0),
    "45° pull and away": (1, 0, 1),
    "45° pull and towards": (1, 0, -1),
    "45° pull and up": (1, 1, 0),
    "45° away and down": (0, -1, 1),
}


@pytest.mark.parametrize("radius", [0.30, 0.35, 0.50, 0.65])
def test_the_true_arc_opens_the_door_gently(
    radius: float, make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env(radius)
    env.reset(seed=0)
    forces, slips, grasped = [], [], []
    for command in arc_commands(radius):
        _, _, terminated, truncated, info = env.step(command)
        forces.append([info[name] for name in FORCES])
        slips.append(info["slip"])
        grasped.append(info["grasped"])
        if terminated or truncated:
            break
    assert (terminated, truncated) == (True, False)
    assert info["success"]
    assert info["door_angle"] > np.radians(60)
    assert np.abs(forces).max() < 2.0, "the right radius needs no force but friction"
    assert max(slips) < 1e-3
    assert all(grasped)


def test_the_true_arc_opens_the_heavy_door(
    make_env: Callable, arc_commands: Callable
) -> None:
    """14 N along the opening motion is what closer and friction ask for."""
    env = make_env("heavy")
    env.reset(seed=0)
    forces, slips = [], []
    for command in arc_commands(0.5):
        _, _, terminated, _, info = env.step(command)
        forces.append([info[name] for name in FORCES])
        slips.append(info["slip"])
        if terminated:
            break
    assert info["success"]
    tangential, vertical, radial = np.array(forces)[200:].T
    assert np.abs(tangential - 14.0).max() < 1.0
    assert np.abs(vertical).max() < 2.0
    assert np.abs(radial).max() < 2.0
    assert max(slips) < 2e-3


@pytest.mark.parametrize("ratio", [0.8, 0.9, 1.1, 1.2])
def test_a_wrong_radius_shows_as_radial_force(
    ratio: float, make_env: Callable, arc_commands: Callable
) -> None:
    """At rest the servo pulls the handle off its circle by K (distance - R).

    A millimetre of slip takes a fifth of that; K times the distance that is really
    left between hand and command is the force on the hand, to a newton: the weak
    posture springs of the arm's self-motion make the difference.
    """
    radius = 0.5
    env = make_env(radius)
    env.reset(seed=0)
    commands = arc_commands(radius * ratio, degrees=25.0, duration=4.0)
    for command in commands:
        observation, *_, info = env.step(command)
    x, _, z = commands[-1, :3]
    off_circle = np.hypot(x, z + radius) - radius
    assert np.sign(off_circle) == np.sign(ratio - 1)
    assert info["force_radial"] == pytest.approx(
        SERVO_STIFFNESS[0] * off_circle, rel=0.2
    )
    left = commands[-1, :3] - observation["ee_pose"][:3]
    assert observation["wrench"][:3] == pytest.approx(
        -SERVO_STIFFNESS[0] * left, abs=1.0
    )
    assert abs(info["force_tangential"]) < 1.5
    assert info["grasped"]
    assert info["slip"] < 2e-3


@pytest.mark.parametrize("radius", [0.35, 0.65])
@pytest.mark.parametrize("name", DIRECTIONS)
def test_grasp_survives_20_newtons(
    name: str, radius: float, make_env: Callable
) -> None:
    """20 N through the grasp for 2 s: an external force on the hand supplies them.

    The servo takes a part of what is applied, so the applied force is raised until
    20 N arrive at the handle. The door is locked.
    """
    env: DoorOpeningEnv = make_env(radius)
    env.model.joint("hinge").range = (0.0, 1e-4)
    env.reset(seed=0)
    direction = np.array(DIRECTIONS[name]) / np.linalg.norm(DIRECTIONS[name])
    applied, slips, through = 0.0, [], []
    for _ in range(300):
        push_hand(env, applied * direction)
        *_, info = env.step(np.zeros(6))
        through.append(np.array([info[n] for n in FORCES]) @ direction)
        applied += 0.1 * (20.0 - through[-1])
        slips.append(info["slip"])
        assert info["grasped"]
    assert through[99:] == pytest.approx([20.0] * 201, abs=0.5)
    assert max(slips) < 5e-3


def push_hand(env: DoorOpeningEnv, force_d: np.ndarray) -> None:
    """Apply a force, given in the task frame [N], at the hand point."""
    body = env.data.body("gripper_link")
    force = task_rotation_w() @ force_d
    body.xfrc_applied[:3] = force
    body.xfrc_applied[3:] = np.cross(env.data.site("hand").xpos - body.xipos, force)


@pytest.mark.parametrize("radius", [0.35, 0.50, 0.65])
def test_closed_door_is_held_still(radius: float, make_env: Callable) -> None:
    env = make_env(radius)
    first, _ = env.reset(seed=0)
    for _ in range(1000):
        observation, _, terminated, _, info = env.step(np.zeros(6))
        moved = observation["ee_pose"][:3] - first["ee_pose"][:3]
        assert np.abs(moved).max() < 1e-3
        assert not terminated
    assert abs(info["door_angle"]) < np.radians(0.1)
    assert info["grasped"]
    assert info["slip"] < 1e-4


def test_closed_door_is_held_against_a_closer(make_env: Callable) -> None:
    env = make_env({"closer_preload": 5.0, "closer_stiffness": 1.0})
    env.reset(seed=0)
    for _ in range(1000):
        *_, info = env.step(np.zeros(6))
    assert abs(info["door_angle"]) < np.radians(0.1)
    assert info["slip"] < 1e-3


def test_weld_holds_what_friction_cannot(make_env: Callable) -> None:
    """60 N downwards: the pads slide along the bar, the weld does not."""
    slip = {}
    for grasp in ("contact", "weld"):
        env = make_env({"hinge_friction": 50.0}, grasp=grasp)
        env.reset(seed=0)
        for step in range(150):
            push_hand(env, np.array([0.0, -60.0 * min(1.0, step / 100), 0.0]))
            *_, info = env.step(np.zeros(6))
        slip[grasp] = info["slip"]
    assert slip["weld"] < 1e-3
    assert slip["contact"] > 5e-3


def test_weld_opens_the_door(make_env: Callable, arc_commands: Callable) -> None:
    env = make_env("medium", grasp="weld")
    env.reset(seed=0)
    slips = []
    for command in arc_commands(0.5):
        _, _, terminated, _, info = env.step(command)
        slips.append(info["slip"])
        if terminated:
            break
    assert info["success"]
    assert max(slips) < 5e-4


def test_pulling_far_too_hard_loses_the_grasp(make_env: Callable) -> None:
    env = make_env({"hinge_friction": 50.0, "closer_preload": 50.0})
    env.reset(seed=0)
    for step in range(400):
        push_hand(env, np.array([min(2.0 * step, 200.0), 0.0, 0.0]))
        _, _, terminated, _, info = env.step(np.array([0.3, 0, 0, 0, 0, 0]))
        if terminated:
            break
    assert terminated
    assert info["failure"] == "grasp_lost"
    assert not info["grasped"]
    assert not info["success"]


@pytest.mark.parametrize(("right", "left"), [(1, 1), (1, 0), (0, 1), (0, 0)])
def test_grasped_means_both_pads(right: int, left: int, make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    env.data.sensor("right_pad_contact").data[:] = right
    env.data.sensor("left_pad_contact").data[:] = left
    reader = Reader.of("contact", "pose")
    reading = reader.door_reading(env.data.sensordata.tolist())
    assert reading.grasped is (right == left == 1)
