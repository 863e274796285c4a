"""The friction grasp: it opens doors, holds 20 N, and keeps a closed door closed."""

from typing import Any

import numpy as np
import pytest

from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.robot.model import SERVO_STIFFNESS

pytestmark = pytest.mark.slow

REST = np.zeros(6)

# Task frame: x pulls the door open, y is up, z points away from the hinge.
DIRECTIONS = {
    "pull": (1, 0, 0),
    "push": (-1, 0, 0),
    "away from the hinge": (0, 0, 1),
    "up": (0, 1, 0),
    "45° pull and towards": (1, 0, -1),
    "45° away and down": (0, -1, 1),
}


def forces(info: dict[str, Any]) -> list[float]:
    return [info[f"force_{axis}"] for axis in ("tangential", "vertical", "radial")]


@pytest.mark.parametrize(
    ("door", "grasp", "pull", "most", "slip"),
    [
        (0.30, "contact", 0.0, (2.0, 2.0), 1e-3),
        (0.65, "contact", 0.0, (2.0, 2.0), 1e-3),
        (0.50, "weld", 0.0, (np.inf, np.inf), 5e-4),
        ("heavy", "contact", 14.0, (1.0, 2.0), 2e-3),
    ],
)
def test_the_true_arc_opens_the_door_gently(
    door, grasp, pull, most, slip, start_env, arc_commands
):
    """The right radius needs no force but what closer and friction ask for."""
    env = start_env(door, grasp=grasp)
    seen, slips = [], []
    for command in arc_commands(env.door.radius):
        _, _, terminated, truncated, info = env.step(command)
        seen.append(forces(info))
        slips.append(info["slip"])
        assert info["grasped"]
        if terminated or truncated:
            break
    assert (terminated, truncated, info["success"]) == (True, False, True)
    assert info["door_angle"] > np.radians(60)
    tangential, *beside = np.array(seen)[200 if pull else 0 :].T
    assert np.abs(tangential - pull).max() < most[0]
    assert np.abs(beside).max() < most[1]
    assert max(slips) < slip


@pytest.mark.parametrize("ratio", [0.8, 0.9, 1.1, 1.2])
def test_a_wrong_radius_shows_as_radial_force(ratio, start_env, arc_commands):
    """At rest the servo pulls the handle off its circle by K (distance - R).

    A millimetre of slip takes a fifth of that; K times the distance that is really
    left between hand and command is the force on the hand, to a newton: the weak
    posture springs of the arm's self-motion make the difference.
    """
    radius = 0.5
    env = start_env(radius)
    commands = arc_commands(radius * ratio, degrees=25.0, duration=4.0)
    for command in commands:
        observation, *_, info = env.step(command)
    x, _, z = command[:3]
    off_circle = np.hypot(x, z + radius) - radius
    assert np.sign(off_circle) == np.sign(ratio - 1)
    tangential, _, radial = forces(info)
    assert radial == pytest.approx(SERVO_STIFFNESS[0] * off_circle, rel=0.2)
    left = command[:3] - observation["ee_pose"][:3]
    expected = -SERVO_STIFFNESS[0] * left
    assert observation["wrench"][:3] == pytest.approx(expected, abs=1.0)
    assert abs(tangential) < 1.5
    assert info["grasped"]
    assert info["slip"] < 2e-3


@pytest.mark.parametrize(
    ("name", "radius"), [*zip(DIRECTIONS, 3 * [0.35, 0.65], strict=True)]
)
def test_grasp_survives_20_newtons(name, radius, make_env, push_hand):
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
        *_, info = env.step(REST)
        through.append(np.array(forces(info)) @ direction)
        applied += 0.1 * (20.0 - through[-1])
        slips.append(info["slip"])
        assert info["grasped"]
    assert through[99:] == pytest.approx([20.0] * 201, abs=0.5)
    assert max(slips) < 5e-3


@pytest.mark.parametrize(
    ("door", "slip"),
    [
        (0.35, 1e-4),
        (0.65, 1e-4),
        ({"closer": {"preload": 5.0, "stiffness": 1.0}}, 1e-3),
    ],
)
def test_closed_door_is_held_still(door, slip, make_env):
    """Ten seconds, after three of which it is said to have stalled."""
    env = make_env(door)
    first, _ = env.reset(seed=0)
    for _ in range(1000):
        observation, _, terminated, _, info = env.step(REST)
        moved = observation["ee_pose"][:3] - first["ee_pose"][:3]
        assert np.abs(moved).max() < 1e-3
        assert not terminated
    assert abs(info["door_angle"]) < np.radians(0.1)
    assert (info["grasped"], info["failure"]) == (True, "stalled")
    assert info["slip"] < slip


def test_pulling_far_too_hard_loses_the_grasp(start_env, push_hand):
    env = start_env({"hinge_friction": 50.0, "closer": {"preload": 50.0}})
    for step in range(400):
        push_hand(env, np.array([min(2.0 * step, 200.0), 0.0, 0.0]))
        _, _, terminated, _, info = env.step(np.array([0.3, 0, 0, 0, 0, 0]))
        if terminated:
            break
    assert terminated
    assert info["failure"] == "grasp_lost"
    assert (info["grasped"], info["success"]) == (False, False)
