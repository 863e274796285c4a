"""Reaching for a handle as demonstrated, then opening with another agent.

The reach is a movement like any other, learned from demonstrations that begin at many
places and end at the handle. The initial pose of the hand is a via-point at the first
phase, the handle a via-point at the last.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.adaptation import adapt
from gplfd_policies.agents.agent import Agent
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.arrays.shapes import Axes, Bool, Float, Pose, Vectors
from gplfd_policies.control.rendering import ArmRendering
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.movements.movement import GaussianTrajectory, Movement, ViaPoint
from gplfd_policies.movements.skill import fit_skill

GRASPED: Final = "grasped"
"""Signal of demonstrations, (N, 1): 1 while the hand holds the handle, else 0."""

_GRID: Final = np.linspace(0.0, 1.0, 100)
_STIFFEST: Final = np.repeat([most for _, most in ArmRendering.stiffness_range], 3)

Stage = Literal["reach", "back", "in", "close", "shake", "held"]

CLOSING: Final = 0.9
"""Time in which the gripper closes with full force, while the hand waits [s]."""

ATTEMPTS: Final = 3
"""Greatest number of grasps. More would leave no time to open the door."""

CONTACT_FORCE: Final = 8.0
"""Force on the hand that stops a motion [N]: several times the noise of the sensor."""

DAMPING: Final = 400.0
"""D: damping with which the hand yields while the gripper closes [N s/m]."""

SHAKE: Final = (0.006, 0.6)  # Amplitude [m] and duration [s] of the test of a grasp.

RESISTANCE: Final = 1.5
"""Least amplitude of the force that resists the shake if the hand holds something [N].
A rigid handle resists with 12 N, a lever's spring with 2 to 9 N; an empty hand has no
resistance, and noise of 1 N contributes 0.2 N."""

_REST: Final = 0.15  # time for which the hand rests after the shake [s]
_SETTLED: Final = 0.2
"""Forces count as contact only after this time since the beginning of a motion [s]."""
_ARRIVED: Final = 0.005
"""A force nearer than this to the goal is caused by the closing fingers [m]."""
_FINGER: Final = 0.05
"""Distance of an open finger from the middle: the greatest of a contact [m]."""
_BEFORE: Final = np.array([0.12, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Turning point of the hand relative to the goal, where fingers pass [m, rad]."""
_BACK_TIME: Final = 0.9
_IN_TIME: Final = 1.1
_DEEPER: Final = (-1.5, -1.0)
"""Additional depth of the next grasps, in standard deviations."""


def split_at_grasp(
    demonstration: Demonstration, grasped: Bool[np.ndarray, " N"]
) -> tuple[Demonstration, Demonstration]:
    """Split a demonstration where the hand takes hold; both parts have this sample."""
    first = int(np.argmax(grasped))
    if first == 0 or first >= len(grasped) - 1 or not grasped[first:].all():
        raise ValueError(
            "to learn reaching, a demonstration must begin without the handle, take "
            "hold of it and keep it to the end"
        )
    times, poses = demonstration.times, demonstration.poses
    wrenches = demonstration.wrenches
    held = None if wrenches is None else wrenches[first:]
    return (
        Demonstration(times=times[: first + 1], poses=poses[: first + 1]),
        Demonstration(times=times[first:], poses=poses[first:], wrenches=held),
    )


def join_at_grasp(reach: Demonstration, opening: Demonstration) -> Demonstration:
    """Join the parts of `split_at_grasp`; a reach has wrenches of zero, if any."""
    wrenches = opening.wrenches
    if wrenches is not None:
        wrenches = np.concatenate([np.zeros((len(reach.times) - 1, 6)), wrenches])
    return Demonstration(
        times=np.concatenate([reach.times, opening.times[1:]]),
        poses=np.concatenate([reach.poses, opening.poses[1:]]),
        wrenches=wrenches,
    )


def openings(recorded: LabelledDemonstrations) -> Sequence[Demonstration]:
    """Return the part of each demonstration in which the hand holds the handle."""
    return [opening for _, opening in _parts(recorded)] or recorded.demonstrations


def reaches(recorded: LabelledDemonstrations) -> Sequence[Demonstration]:
    """Return the part of each demonstration before the hand holds the handle."""
    parts = _parts(recorded)
    if not parts:
        raise ValueError(
            "these demonstrations do not record when the hand takes hold (signal "
            f"{GRASPED!r}), so reaching cannot be learned from them; leave out --start "
            "approach, or --demonstrations"
        )
    return [reach for reach, _ in parts]


def _parts(
    recorded: LabelledDemonstrations,
) -> list[tuple[Demonstration, Demonstration]]:
    """Return reach and opening of each demonstration; empty without the signal."""
    if not all(GRASPED in signals for signals in recorded.signals):
        return []
    # Without any signals, there are none to pair.
    pairs = zip(recorded.demonstrations, recorded.signals, strict=False)
    return [split_at_grasp(motion, s[GRASPED][:, 0] > 0.5) for motion, s in pairs]


def learn_reach(reaches: Sequence[Demonstration]) -> Movement:
    """Learn the reach from at least two demonstrations that end at the handle."""
    # The rest at the end belongs to the task: the hand closes.
    return fit_skill(align(reaches, trim_rests=False))


class GraspSearch:
    """Commands of one episode, from the standoff until the hand holds the handle.

    1. *Reach*: as learned. A contact stops the motion. Its point r in the hand, of
       which F × (r × F)/F² is known, shows where the handle is.
    2. *Close*: while the gripper closes, the hand follows the force, ė = F/D.
    3. *Shake*: a motion upwards and to the side. If the hand holds something, it is
       resisted, i.e. there is an opposing force, on both axes.
    4. If not, *back* and *in*: straight to the next place.

    Args:
        spread: Standard deviation of the handle's believed position [m].
        duration: Duration of the first reach [s].

    Attributes:
        stage: Current stage; ``"held"`` also after the last failed attempt.
        attempt: Number of the present grasp, from 1.
    """

    def __init__(self, spread: float, duration: float) -> None:
        self._spread, self._duration = spread, duration
        self.stage: Stage = "reach"
        self.attempt, self._since = 1, 0.0
        self._goal, self._from, self._command = np.zeros((3, 6))
        self._forces: list[Vectors] = []

    @property
    def gripper_width(self) -> float:
        """Commanded width of the gripper [m]: open during motions, else closed."""
        return GRIPPER_WIDTH if self.stage in ("reach", "back", "in") else 0.0

    def command(self, observation: Observation, reached: Pose) -> Pose:
        """Return the next commanded pose, given the pose of the learned reach."""
        force, torque = np.split(np.asarray(observation["wrench"]), 2)
        self._since += CONTROL_PERIOD
        since, goal = self._since, self._goal
        match self.stage:
            case "reach":
                self._command = reached
                self._go_on(since >= self._duration, "close")
            case "back":
                self._command = self._toward(goal + _BEFORE, since / _BACK_TIME)
                self._go_on(since >= _BACK_TIME, "in")
            case "in":
                self._command = self._toward(goal, since / _IN_TIME)
                self._go_on(since >= _IN_TIME, "close")
            case "close":
                self._command[:3] += force / DAMPING * CONTROL_PERIOD
                self._go_on(since >= CLOSING, "shake")
            case "shake":
                self._command = self._from.copy()
                if since <= SHAKE[1]:
                    self._forces.append(force)
                    self._command[1:3] += SHAKE[0] * _shake(since / SHAKE[1])
                elif since >= SHAKE[1] + _REST:
                    # Decide by its forces whether the hand holds something.
                    shares = np.arange(1, len(self._forces) + 1) / len(self._forces)
                    forces, waves = np.array(self._forces)[:, 1:], _shake(shares)
                    resistance = -2.0 * (forces * waves.T).mean(axis=0)
                    holds = bool(resistance.min() >= RESISTANCE)
                    self._go_on(holds, "held")
                    if not holds:
                        further = _DEEPER[min(self.attempt, len(_DEEPER)) - 1]
                        deeper = np.array([self._spread * further, 0.0, 0.0])
                        self._again(observation, deeper)
        squared = float(force @ force)
        moving = self.stage in ("reach", "in") and since > _SETTLED
        if moving and squared > CONTACT_FORCE**2:
            if math.dist(self._command[:3], goal[:3]) > _ARRIVED:
                beside = np.cross(force, torque) / squared
                beside *= min(1.0, _FINGER / math.sqrt(beside @ beside))
                self._again(observation, np.array([0.0, *beside[1:]]))
            else:
                self._go_on(True, "close")
        return self._command.copy()

    def _again(self, observation: Observation, beside: Vectors) -> None:
        """Start the next grasp, displaced from this one, unless it was the last."""
        self._command = np.array(observation["ee_pose"])
        if self.attempt < ATTEMPTS:
            self.attempt += 1
            self._goal[:3] += beside
            self._go_on(True, "back")
        else:
            self._go_on(True, "held")

    def _go_on(self, done: bool, stage: Stage) -> None:
        """Begin the next stage once the present one is done."""
        if done:
            self.stage, self._since = stage, 0.0
            self._from, self._forces = self._command.copy(), []

    def _toward(self, goal: Pose, share: float) -> Pose:
        """Return the pose of a minimum-jerk motion at a share of its time."""
        s = min(share, 1.0)
        progress = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        return np.asarray(self._from + progress * (goal - self._from))


def _shake(share: float | Float[np.ndarray, " N"]) -> Float[np.ndarray, "2 ..."]:
    """Return the motion upwards and to the left, of amplitude 1, uncorrelated."""
    angle = 2.0 * math.pi * np.asarray(share)
    return np.array([np.sin(2.0 * angle), np.sin(angle)])


class ReachingAgent:
    """Reaches for the handle, waits until the gripper closes, then uses another agent.

    If the handle's pose is uncertain, a `GraspSearch` corrects the reach by contact.
    The other agent then observes poses relative to the hand pose at the (last) grasp,
    in axes of the task frame, so that it begins at zero, like its demonstrations.

    Args:
        reach: The movement from `learn_reach`.
        then: The agent that opens the door.
        perception: Standard deviations of the handle's believed pose [m, rad].
    """

    def __init__(
        self, reach: Movement, then: Agent, perception: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self._reach, self._then, self._perception = reach, then, perception
        self._door: DoorGeometry | None = None
        self.control, self.dynamics = then.control, then.dynamics
        self.reset({"ee_pose": np.zeros(6)})

    def inform(self, door: DoorGeometry) -> None:
        """Pass on the door of the next episode."""
        self._door = door
        self._then.inform(door)

    def reset(self, observation: Observation) -> None:
        """Begin at the current pose of the hand."""
        start = ViaPoint(phase=0.0, pose=observation["ee_pose"])
        handle = ViaPoint(phase=1.0, pose=np.zeros(6))
        adapted = adapt(self._reach, (start, handle), "process").predict(_GRID)
        self._path = np.hstack([adapted.mean, adapted.std])
        self._elapsed, self._opens = 0.0, False
        # The pose at the grasp, if it is not that of the believed handle.
        self._grasp: Pose | None = None
        self._search: GraspSearch | None = None
        if any(self._perception):
            self._search = GraspSearch(self._perception[0], self._reach.duration)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        search = self._search
        held = self._elapsed >= self._reach.duration + CLOSING
        if search is not None:
            held = search.stage == "held"
        if not held:
            self._elapsed += CONTROL_PERIOD
            phase = np.array([min(self._elapsed / self._reach.duration, 1.0)])
            pose, std = np.split(interpolated(phase, _GRID, self._path)[0], 2)
            if search is not None:
                pose = search.command(observation, pose)
            stiffness = _STIFFEST if self.control == "impedance" else np.full(6, np.nan)
            return AgentStep(action=pose, desired=pose, std=std, stiffness=stiffness)
        # The other agent begins where the hand holds.
        begins, self._opens = not self._opens, True
        if begins and self._search is not None:
            self._grasp = np.array(observation["ee_pose"])
        grasp = self._grasp
        if grasp is not None:
            pose = _moved(observation["ee_pose"], grasp, -1.0)
            observation = {**observation, "ee_pose": pose}
        if begins:
            if grasp is not None and self._door is not None:
                self._then.inform(self._door.seen_from(grasp[:3]))
            self._then.reset(observation)
        step = self._then.act(observation)
        if grasp is None:
            return step
        poses = ("action", "desired", "predicted_mean")
        moved = {name: _moved(getattr(step, name), grasp, 1.0) for name in poses}
        return dataclasses.replace(step, **moved)

    @property
    def gripper_width(self) -> float:
        """Commanded gripper width [m]: open up to the handle, then closed."""
        if self._search is not None:
            return self._search.gripper_width
        return GRIPPER_WIDTH if self._elapsed < self._reach.duration else 0.0

    def forecast(self) -> GaussianTrajectory | None:
        """Return the expected trajectory of the opening, or None."""
        forecast, grasp = self._then.forecast(), self._grasp
        if forecast is None or grasp is None:
            return forecast
        mean = _moved(forecast.mean, grasp, 1.0)
        return dataclasses.replace(forecast, mean=mean)


def _moved(pose: Axes, grasp: Pose, way: float) -> Axes:
    """Return poses with the grasp pose added (way 1) or subtracted (way -1)."""
    turned = compose_rotvecs(pose[..., 3:], way * grasp[3:])
    return np.concatenate([pose[..., :3] + way * grasp[:3], turned], axis=-1)
