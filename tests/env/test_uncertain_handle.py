"""Episodes in which the robot believes the handle to be where it is not."""

import math
from typing import Any

import numpy as np
import pytest

import gplfd_env
from gplfd_env.conventions.constants import GRIPPER_WIDTH
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.variation import BELIEF_LIMIT, Perception
from gplfd_env.robot.gripper import AT_REST, RELEASE_DISTANCE, SPEED, Gripper
from gplfd_env.spatial.se3 import into_axes
from gplfd_env.task.opening import TRIED_ANGLE

UNCERTAIN: dict[str, Any] = {
    "start": "approach",
    "randomization": {"perception": (0.01, math.radians(2.0))},
}


def test_errors_are_truncated_gaussians():
    rng = np.random.default_rng(0)
    one = Perception(position=0.01, rotation=0.05)
    errors = np.array([list(one.drawn(rng).values()) for _ in range(4000)])
    scaled = errors / np.repeat([0.01, 0.05], 3)
    assert np.abs(scaled).max() <= BELIEF_LIMIT
    # Variance of a standard Gaussian within ± c: 1 - 2 c φ(c) / (2 Φ(c) - 1).
    c = BELIEF_LIMIT
    density = math.exp(-(c**2) / 2.0) / math.sqrt(2.0 * math.pi)
    variance = 1.0 - 2.0 * c * density / math.erf(c / math.sqrt(2.0))
    assert scaled.var() == pytest.approx(variance, rel=0.02)
    assert np.abs(np.corrcoef(scaled.T) - np.eye(6)).max() <= 0.06


@pytest.mark.parametrize("door", ["small", {"handle": "lever", "latch": "spring"}])
def test_the_task_frame_is_at_the_believed_grasp(door, make_env):
    base = "fixed" if door == "small" else "mobile"
    env = make_env(door, base=base, **UNCERTAIN)
    observation, info = env.reset(seed=4)
    belief = np.array(env.variation.placement.belief)
    standoff = observation["ee_pose"]
    distance = env.variation.standoff.distance
    assert np.linalg.norm(standoff[:3]) == pytest.approx(distance, abs=1e-9)
    assert standoff[3:] == pytest.approx(np.zeros(3), abs=1e-9)
    # The true grasp in the believed frame: p = -Rᵀ shift.
    held = into_axes(belief[3:], -belief[:3])
    assert info["handle_pose"][:3] == pytest.approx(held, abs=3e-4)
    # Seen from there, and with its axes, the door is the one that everybody knows.
    told, plain = env.door_geometry.seen_from(held), DoorGeometry.of(env.door)
    assert told.radius == pytest.approx(plain.radius)
    for name in ("hinge", "axis", "pull", *(["spindle"] if base == "mobile" else [])):
        turned = into_axes(-belief[3:], getattr(told, name))
        assert turned == pytest.approx(getattr(plain, name), abs=1e-9), name


def test_the_gripper_closes_where_the_hand_rests_and_opens_where_it_leaves():
    gripper = Gripper(DoorConfig(), GRIPPER_WIDTH, uncertain=True)

    def widths(*places: float, taken: bool = False) -> list[float]:
        seen = []
        for z in places:
            gripper.close_at_handle([0.0, 0.0, z, 0.0, 0.0, 0.0], taken=taken)
            seen.append(gripper.width)
        return seen

    periods = round(AT_REST[2] / 0.01)
    assert set(widths(*[1.1 * AT_REST[0]] * 100)) == {GRIPPER_WIDTH}, "too far away"
    moving = np.arange(0.08, 0.02, -1.1 * AT_REST[1])
    assert set(widths(*moving)) == {GRIPPER_WIDTH}
    resting = widths(*[0.02] * (periods + 30))
    assert resting[periods - 2] == GRIPPER_WIDTH
    assert resting[-1] == pytest.approx(GRIPPER_WIDTH - 30 * 0.01 * SPEED, abs=2e-3)
    closed = widths(*[0.02 + 0.9 * RELEASE_DISTANCE] * 100)
    assert closed[-1] == 0.0, "it may centre itself"
    assert widths(*np.arange(0.05, 0.2, 0.01), taken=True)[-1] == 0.0, "it holds"
    assert widths(*np.arange(0.2, 1.0, 0.01))[-1] > 0.05, "it has left"


def test_a_handle_that_slips_away_at_first_can_be_taken_again(make_env):
    door = {"preset": "small", "hinge_friction": 20.0}
    env = make_env(door, id=gplfd_env.GRIPPER_ENVIRONMENT_ID, **UNCERTAIN)
    start = env.reset(seed=0)[0]["ee_pose"]
    x, _, z = -np.array(env.variation.placement.belief[:3])
    goal = np.array([x, 0.0, z, 0.0, 0.0, 0.0])

    def command(pose: np.ndarray, width: float, n: int) -> Any:
        for _ in range(n):
            _, _, terminated, _, info = env.step(np.append(pose, width))
            assert not terminated
        return info

    for share in np.linspace(1.0, 0.0, 100):
        command(share * start + (1.0 - share) * goal, GRIPPER_WIDTH, 1)
    assert command(goal, 0.0, 90)["grasped"]
    # Torn along the closed bar and off its end: nobody told the fingers to open.
    for y in np.arange(0.0, 0.25, 0.001):
        info = command(goal + y * np.eye(6)[1], 0.0, 1)
    assert (info["grasped"], info["failure"]) == (False, "")
    assert abs(info["door_angle"]) < TRIED_ANGLE
