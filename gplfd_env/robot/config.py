"""A robot as a record: its URDF, its hand, and how it stands before a door."""

import dataclasses
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from gplfd_env.conventions.constants import Array, Base
from gplfd_env.doors.config import DoorConfig, Handle, HingeSide, Swing
from gplfd_env.validation.fields import check_choice

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class Stance:
    """Pose of the robot in front of a closed door; assets/README.md tells how found."""

    handle_xy_w: tuple[float, float]
    """Closed handle in the base frame, without placement error [m]."""
    door_yaw: float
    """Heading of "straight into the closed door" in the base frame [rad]."""
    grasp_yaw: float = 0.0
    """Constant yaw of the hand on the handle, counter-clockwise from above [rad]. It is
    zero for a lever or knob, whose axis is the hand's: there it would turn a wrist
    that is nearly at its limit."""
    below_handle: float
    """Height of the grasped point minus the lift's position [m]."""
    closed_posture: tuple[float, ...]
    """Arm joints that hold the closed handle, to 1 mrad [rad]; refined at build
    time."""
    roll: float = 0.0
    """Roll of the wrist relative to the grasp of a vertical bar [rad]: a quarter turn
    for a lever or knob, which the fingers grasp from above and below."""
    radius: float
    """Greatest handle-to-hinge distance that is opened to the task's angle [m]."""
    height: float
    """Greatest height at which the handle can be held all the way [m]."""


Held = Handle | Literal["level-bar"]
"""What the hand holds: a handle, or the bar of a flap, which is level."""


class Before(NamedTuple):
    """The doors before which a robot takes one stance."""

    base: Base
    swing: Swing
    held: Held
    hinge_side: HingeSide

    @classmethod
    def of(cls, door: DoorConfig, base: Base) -> "Before":
        """Return those that a door is one of."""
        level = door.motion == "flap"
        side: HingeSide = "right" if level else door.hinge_side
        return cls(base, door.swing, "level-bar" if level else door.handle, side)


class Capsule(NamedTuple):
    """Collision geometry of a link."""

    name: str
    body: str
    ends: tuple[float, float, float, float, float, float]  # In the link's frame [m].
    radius: float  # [m]


@dataclass(frozen=True, kw_only=True, slots=True)
class RobotConfig:
    """An arm with a gripper, on a stand or a base of its own.

    `gplfd_env.robot.urdf.robot_of_urdf` makes one of a URDF; the robots of this
    project are in `gplfd_env.robot.robots.ROBOTS`.

    The *grasp frame* lies between the finger tips: its x axis is the direction in which
    the fingers close, and the hand approaches along its negative z axis.
    """

    name: str
    """What messages and recordings call it."""
    urdf: str
    """Its description: a path, or the name of a file of ``assets/``."""
    base: Base = "fixed"
    """Whether it stands or drives."""
    arm: tuple[str, ...]
    """The arm's joints, from the base to the hand."""
    tool: str
    """Link of the hand."""
    grasp_point: Vector
    """Origin of the grasp frame in the frame of the tool [m]."""
    approach: Vector = (0.0, 0.0, 1.0)
    """Direction of the approach in the frame of the tool, a unit vector."""
    closing: Vector = (1.0, 0.0, 0.0)
    """Direction in which the first finger opens, perpendicular to the approach."""
    fingers: tuple[str, str] = (
        "gripper_right_finger_joint",
        "gripper_left_finger_joint",
    )
    """Prismatic joints of the fingers: zero is closed."""
    finger_stroke: float = 0.045
    """How far a finger opens from the middle [m]."""
    flange: str = ""
    """Link of the URDF on which the generic gripper is mounted; "" if it has its own.
    Then `tool` and the joints of the fingers are the gripper's."""
    flange_axes: tuple[Vector, Vector] = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    """Directions of approach and of closing in the frame of the flange."""
    stand: bool = True
    """Whether the URDF is an arm alone, which a stand with a lift carries."""
    armature: tuple[float, ...]
    """Rotor inertia of the arm's joints, as the joint sees it [kg m²]."""
    root: str = "stand_base"
    """Body of the base that stands on the floor."""
    lift: str = "stand_lift"
    """Joint that sets the height of the arm."""
    sensor: str
    """Body that the wrist's force and torque sensor carries, with all beyond it."""
    sensor_rotation: tuple[Vector, Vector, Vector] = (
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
    )
    """Axes of `tool` in the frame of `sensor`, a rotation matrix."""
    forearm: str
    """Body on which a disturbance pushes."""
    head: tuple[str, Vector] = ("stand_base", (-0.19, 0.0, 1.47))
    """Body that carries the camera "head", and where."""
    hand_camera: tuple[Vector, Vector, Vector]
    """Camera at the hand, frame of `tool`: position [m], its right and up axes."""
    capsules: tuple[Capsule, ...]
    """Collision geometry of a mobile robot, without its fingers."""
    stances: tuple[tuple[Before, Stance], ...]
    """How it stands before doors."""

    def __post_init__(self) -> None:
        check_choice("base", self.base, ("fixed", "mobile"))

    def __hash__(self) -> int:
        # Every reset looks up scenes by robot; all stances would take 20 µs.
        return hash((self.name, self.urdf, self.base, self.tool))

    @property
    def grasp_axes(self) -> Array:
        """Axes of the grasp frame as columns in the frame of the tool, (3, 3)."""
        return grasp_axes(self.approach, self.closing)

    def on(self, base: Base) -> "RobotConfig":
        """Return the same robot on another base."""
        return self if base == self.base else dataclasses.replace(self, base=base)

    def stance(self, door: DoorConfig) -> Stance:
        """Return how it stands before a door; raise a ValueError if it cannot."""
        before = Before.of(door, self.base)
        for doors, stance in self.stances:
            if doors == before:
                return stance
        advice = '; give base="mobile"' if self.base == "fixed" else ""
        raise ValueError(
            f"the robot {self.name} has no posture for a door with "
            f"handle={door.handle!r}, swing={door.swing!r} and "
            f"hinge_side={door.hinge_side!r} on a {self.base} base{advice}"
        )


def grasp_axes(approach: Vector, closing: Vector) -> Array:
    """Return the axes of a grasp frame as columns, (3, 3), from two unit vectors."""
    back = -np.array(approach)
    across = np.array(closing)
    return np.column_stack([across, np.cross(back, across), back])


BASE_RADIUS: Final = 0.27
"""Radius of the base's outline [m]."""

HELD: Final[tuple[Held, ...]] = (
    "bar", "lever", "knob", "paddle", "touch-bar", "handleset", "level-bar",
)  # fmt: skip
"""Everything that a hand can hold."""
