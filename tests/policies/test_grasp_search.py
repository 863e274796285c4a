"""Grasping a handle whose pose is uncertain, at a handle made of springs."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import AgentStep
from gplfd_policies.agents.reaching import (
    CLOSING,
    CONTACT_FORCE,
    SHAKE,
    GraspSearch,
    ReachingAgent,
    learn_reach,
)

START = np.array([0.15, 0.01, -0.02, 0.0, 0.0, 0.0])
DURATION = 1.5
SERVO = 2000.0

Wrench = Callable[[np.ndarray, str], np.ndarray]


def run(wrench: Wrench) -> tuple[GraspSearch, list[tuple[str, np.ndarray]]]:
    """Let the hand be where it is commanded, until something is held or given up."""
    search, pose, seen = GraspSearch(0.01, DURATION), START.copy(), []
    while search.stage != "held":
        stage = search.stage
        share = min((len(seen) + 1) * CONTROL_PERIOD / DURATION, 1.0)
        observation = {"ee_pose": pose, "wrench": wrench(pose, stage)}
        pose = search.command(observation, (1.0 - share) * START)
        seen.append((stage, pose))
        assert len(seen) < 3000
    return search, seen


def spring(handle: np.ndarray, axes: list[int]) -> Wrench:
    """Return a handle that resists on some axes while the fingers close on it."""

    def wrench(pose: np.ndarray, stage: str) -> np.ndarray:
        force = np.zeros(6)
        if stage in ("close", "shake"):
            force[axes] = SERVO * (handle - pose[:3])[axes]
        return force

    return wrench


def test_it_centres_itself_and_holds_what_resists():
    handle = np.array([0.0, 0.004, -0.015])
    search, seen = run(spring(handle, [1, 2]))
    assert (search.attempt, search.gripper_width) == (1, 0.0)
    assert seen[-1][1][:3] == pytest.approx(handle, abs=3e-4)
    stages = [stage for stage, _ in seen]
    assert sorted(set(stages), key=stages.index) == ["reach", "close", "shake"]
    shaken = np.array([pose for stage, pose in seen if stage == "shake"])
    assert np.ptp(shaken[:, 1:3], axis=0) == pytest.approx([2 * SHAKE[0]] * 2, rel=0.02)
    assert np.ptp(shaken[:, [0, 3, 4, 5]]) == 0.0, "a door is not pulled open"
    lasting = DURATION + CLOSING + SHAKE[1] + 0.15
    duration = len(seen) * CONTROL_PERIOD
    assert duration == pytest.approx(lasting, abs=3 * CONTROL_PERIOD)


@pytest.mark.parametrize("point", [(0.02, 0.045), (-0.03, 0.0), (0.0, -0.1)])
def test_it_goes_where_it_met_the_handle(point):
    """A force F at r has the moment r × F: r is known across F."""
    lever, force = np.array([-0.035, *point]), np.array([30.0, 0.0, 0.0])

    def wrench(pose: np.ndarray, stage: str) -> np.ndarray:
        met = stage == "reach" and pose[0] < 0.05
        return np.append(force, np.cross(lever, force)) * met

    search, seen = run(wrench)
    reach = [pose for stage, pose in seen if stage == "reach"]
    assert reach[-1][0] > 0.045, "it stops"
    goal = next(p for (a, p), (b, _) in pairwise(seen) if (a, b) == ("in", "close"))
    assert goal[1:3] == pytest.approx(
        np.array(point) * min(1.0, 0.05 / np.linalg.norm(point)), abs=1e-9
    )
    assert np.linalg.norm(force) > CONTACT_FORCE
    assert search.gripper_width == 0.0


class Watching:
    """Commands what it observes and a little more, and remembers it."""

    control, dynamics = "pose", None

    def __init__(self) -> None:
        self.told: list[DoorGeometry] = []
        self.begun: list[np.ndarray] = []

    def inform(self, door):
        self.told.append(door)

    def reset(self, observation):
        self.begun.append(observation["ee_pose"])

    def act(self, observation):
        more = np.array([0.01, 0.0, 0.0])
        pose = observation["ee_pose"]
        turned = compose_rotvecs(more, pose[3:])
        return AgentStep(action=np.concatenate([pose[:3] + more, turned]))

    def forecast(self):
        return None


@pytest.fixture(scope="module")
def reach():
    return learn_reach(Teacher().standard_reaches(seed=0))


def test_who_opens_begins_at_zero_where_the_hand_holds(reach):
    then, door = Watching(), DoorGeometry.of(DoorConfig(radius=0.5))
    agent = ReachingAgent(reach, then, (0.01, 0.03))
    pose, held = START.copy(), np.array([0.0, 0.004, -0.015])
    resist = spring(held, [1, 2])
    agent.inform(door)
    agent.reset({"ee_pose": pose})
    for _ in range(600):
        stage = agent._search.stage
        wide = agent.gripper_width == GRIPPER_WIDTH
        assert wide == (stage in ("reach", "back", "in"))
        observation = {"ee_pose": pose, "wrench": resist(pose, stage)}
        step = agent.act(observation)
        if stage == "held":
            break
        pose = step.action
    grasp = pose
    assert then.begun[0] == pytest.approx(np.zeros(6), abs=1e-12)
    # The true hinge, seen from the hand, on the axes of the task frame.
    assert then.told[0] is door
    assert then.told[1].hinge == pytest.approx((door.hinge - grasp[:3]) * [1, 0, 1])
    # In the task frame the command is as far from the hand as it was meant to be.
    turned = np.concatenate([grasp[:3], compose_rotvecs([0.0, 0.4, 0.0], grasp[3:])])
    step = agent.act({"ee_pose": turned, "wrench": np.zeros(6)})
    assert (step.action - turned)[:3] == pytest.approx([0.01, 0.0, 0.0])
    away = compose_rotvecs(step.action[3:], -turned[3:])
    assert away == pytest.approx([0.01, 0.0, 0.0], abs=1e-9)
    assert len(then.begun) == 1
    agent.reset({"ee_pose": START})
    assert agent._search.stage == "reach"
