"""Converts inputs of a device to commands for the hand.

A virtual spring pulls the hand to a target that the person moves. The spring is soft,
and softer across the motion than along it, so that inaccurate inputs cause small forces
on the handle. The wrist rotates with the door, so that two degrees of freedom suffice.
"""

import math
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from jaxtyping import Float

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.robot.model import SERVO_STIFFNESS
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_experiments.data.teacher.random_motion import minimum_jerk
from gplfd_experiments.episodes.leading import BLEND_TIME, PULLS
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.demonstrations.demonstration import Who

INPUTS: Final = ("held", "u", "v", "x", "y", "z", "about_x", "about_y", "about_z")
"""Sample of a device in a control period: whether the pointer is pressed, its position
in the picture from the left and from the top in widths and heights, and six deflections
(keys, wheel, SpaceMouse) from -1 to 1 along and about the axes of the task frame."""

SPRING: Final = (300.0, 100.0)
"""Stiffness of the virtual spring [N/m, N m/rad]."""
_FORCE: Final = 45.0  # Largest force of the spring [N].
_ACROSS: Final = 0.1  # Share of the stiffness across the motion of a moving hand.
_MOVING: Final = 0.05  # Speed from which a hand counts as moving [m/s].
_SPEED: Final = 0.3  # Speed of the target at full deflection [m/s].
_TURN: Final = 0.1  # Deflection of the wrist's spring at full input [rad]: 10 N m.


def checked_input(values: object) -> Float[np.ndarray, " 9"]:
    """Return a sample of a device, in the order of `INPUTS`; deflections within ±1.

    Raises ValueError if it is not nine finite numbers.
    """
    try:
        sample = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        sample = np.empty(0)
    if sample.shape != (len(INPUTS),) or not np.isfinite(sample).all():
        raise ValueError(
            f"an input must be {len(INPUTS)} finite numbers {', '.join(INPUTS)}; got "
            f"{values!r:.80}"
        )
    sample[3:] = np.clip(sample[3:], -1.0, 1.0)
    return sample


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """A static camera: position and axes in the task frame.

    The columns of `axes` point to the right, upwards and backwards in the picture. A
    position in the picture stands for a point in a plane with the normal `normal`, in
    which the door moves the hand.
    """

    position: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"]
    extent: tuple[float, float]
    """Half the width and height of the picture at a distance of 1."""
    normal: Float[np.ndarray, " 3"]

    @classmethod
    def of(cls, data: mujoco.MjData, camera: str, aspect: float, level: bool) -> "View":
        """Return the view of a scene's camera; `level`: the door has a level hinge."""
        task, seen = data.site("task_frame"), data.camera(camera)
        to_task = task.xmat.reshape(3, 3).T
        fovy = float(data.model.camera(camera).fovy[0])
        height = math.tan(math.radians(fovy) / 2.0)
        return cls(
            position=to_task @ (seen.xpos - task.xpos),
            axes=to_task @ seen.xmat.reshape(3, 3),
            extent=(aspect * height, height),
            normal=np.array([0.0, 0.0, 1.0] if level else [0.0, 1.0, 0.0]),
        )

    def point(
        self, u: float, v: float, level: Float[np.ndarray, " 3"]
    ) -> Float[np.ndarray, " 3"] | None:
        """Return the point at a position in the picture, in the plane through `level`.

        None beyond the horizon of the plane.
        """
        width, height = self.extent
        ray = self.axes @ [(2.0 * u - 1.0) * width, (1.0 - 2.0 * v) * height, -1.0]
        along = float(self.normal @ ray)
        distance = float(self.normal @ (level - self.position))
        if not distance / along > 0.0 if along else True:
            return None
        return np.asarray(self.position + distance / along * ray)

    def place(self, point: Float[np.ndarray, " 3"]) -> tuple[float, float]:
        """Return the position of a point in the picture, (u, v)."""
        right, up, back = self.axes.T @ (point - self.position)
        width, height = self.extent
        return 0.5 - 0.5 * right / (back * width), 0.5 + 0.5 * up / (back * height)


class Lead:
    """The target of one demonstration, moved by the samples of a device.

    `servo` is the stiffness of the arm [N/m] that renders the spring.
    """

    def __init__(
        self, view: View, *, force: float = _FORCE, servo: float = SPRING[0]
    ) -> None:
        self._view, self._reach = view, force / SPRING[0]
        self._give = SPRING[0] / servo
        self.target: Float[np.ndarray, " 3"] = np.zeros(3)
        """Target of the spring [m]."""
        self._grip: Float[np.ndarray, " 3"] | None = None
        self._level, self._active = np.zeros(3), False

    def command(
        self,
        sample: Float[np.ndarray, " 9"],
        observation: Observation,
        wrist: Float[np.ndarray, " 3"],
    ) -> Float[np.ndarray, " 6"]:
        """Return the commanded pose of the hand for a control period [m, rad].

        `wrist` is its rotation vector without deflections about the axes.

        Pressing the pointer does not move the hand; only motions of the pointer count.
        After release, the hand keeps its position.
        """
        hand, velocity = observation["ee_pose"][:3], observation["ee_twist"][:3]
        shift = _SPEED * CONTROL_PERIOD * sample[3:6]
        held, deflected = bool(sample[0]), bool(sample[3:6].any())
        if held:
            if self._grip is None:
                self._level = hand
            point = self._view.point(sample[1], sample[2], self._level)
            if point is not None:
                start = hand - point if self._grip is None else self._grip
                self._grip = start + shift
                self.target = point + self._grip
        else:
            self._grip = None
            let_go = self._active and not deflected
            self.target = (hand if let_go else self.target) + shift
        self._active = held or deflected
        error = self.target - hand
        error *= self._reach / max(self._reach, float(np.linalg.norm(error)))
        if not held:
            self.target = hand + error
        speed = float(np.linalg.norm(velocity))
        along = velocity * (velocity @ error) / speed**2 if speed else error
        moving = (1.0 - _ACROSS) * min(1.0, speed / _MOVING)
        stretch = moving * along + (1.0 - moving) * error
        turned = compose_rotvecs(_TURN * sample[6:], wrist)
        return np.concatenate([hand + self._give * stretch, turned])


class Person:
    """Leads the hand of a policy while a device is held or deflected.

    A `gplfd_experiments.episodes.leading.Leader`. The pull is limited, and taking the
    hand and handing it over are blended, as by the synthetic corrector.
    """

    by: Who = "person"

    def __init__(self, view: View) -> None:
        self._view = view

    def begin(self, door: DoorGeometry) -> None:
        """Watch an episode at a door."""
        self._door = door
        force = PULLS[door.travel > 0.0]
        self.spring = Lead(self._view, force=force, servo=SERVO_STIFFNESS[0])
        self._share = 0.0  # blend from the policy's command (0) to the person's (1)

    def take(self, sample: Float[np.ndarray, " 9"], handle_angle: float) -> None:
        """Set the sample of the next control period, and the handle's angle [rad]."""
        self._sample, self._turn = sample, handle_angle

    def lead(
        self, observation: Observation, step: AgentStep
    ) -> Float[np.ndarray, " 6"] | None:
        """Return the command while the hand is led or handed over."""
        active = bool(self._sample[0] or self._sample[3:].any())
        change = CONTROL_PERIOD / BLEND_TIME
        self._share = np.clip(self._share + (change if active else -change), 0.0, 1.0)
        if active:
            self._held = self._sample  # It continues to pull during the hand-over.
        elif self._share == 0.0:
            self.spring.target = np.array(observation["ee_pose"][:3])
            return None
        angle = self._door.angle(observation["ee_pose"][:3])
        wrist = self._door.easy_hand_poses(angle, self._turn)[3:]
        pose = self.spring.command(self._held, observation, wrist)
        share = minimum_jerk(np.array(self._share))
        return np.asarray((1.0 - share) * step.action + share * pose)
