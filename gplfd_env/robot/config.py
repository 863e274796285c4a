"""Configuration of a robot: URDF, hand, and pose in front of a door."""

import csv
import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np

from gplfd_env.conventions.assets import asset_path
from gplfd_env.conventions.constants import Array, Base, Vector
from gplfd_env.doors.config import DoorConfig, Handle, HingeSide, Swing
from gplfd_env.validation.fields import check_choice


@dataclass(frozen=True, kw_only=True, slots=True)
class Stance:
    """Pose of the robot in front of a closed door; see assets/README.md for sources."""

    handle_xy_w: tuple[float, float]
    """Closed handle in the base frame, without placement error [m]."""
    door_yaw: float
    """Heading perpendicular into the closed door in the base frame [rad]."""
    grasp_yaw: float = 0.0
    """Constant yaw of the hand on the handle, counter-clockwise from above [rad]; zero
    for a lever or knob, where it would turn a wrist that is nearly at its limit."""
    below_handle: float
    """Height of the grasped point minus the lift's position [m]."""
    closed_posture: tuple[float, ...]
    """Arm joint positions that hold the closed handle, to 1 mrad [rad]."""
    roll: float = 0.0
    """Roll of the wrist relative to the grasp of a vertical bar [rad]: a quarter turn
    for a lever or knob, which the fingers grasp from above and below."""
    radius: float
    """Greatest handle-to-hinge distance at which the task's angle is reached [m]."""
    height: float
    """Greatest height at which the handle can be held during the whole motion [m]."""


HeldHandle = Handle | Literal["level-bar"]
"""What the hand holds: a handle, or the level bar of a flap."""


class StanceGroup(NamedTuple):
    """The doors that share a stance of the robot."""

    base: Base
    swing: Swing
    held: HeldHandle
    hinge_side: HingeSide

    @classmethod
    def of(cls, door: DoorConfig, base: Base) -> "StanceGroup":
        """Return the group of doors to which a door belongs."""
        side: HingeSide = "right" if door.level else door.hinge_side
        held: HeldHandle = "level-bar" if door.level else door.handle
        return cls(base, door.swing, held, side)


class Capsule(NamedTuple):
    """Collision geometry of a link."""

    name: str
    body: str
    ends: tuple[float, float, float, float, float, float]  # In the link's frame [m].
    radius: float  # [m]


@dataclass(frozen=True, kw_only=True, slots=True)
class RobotConfig:
    """An arm with a gripper, on the generic stand or its own base.

    `gplfd_env.robot.urdf.robot_of_urdf` makes one; `gplfd_env.robot.robots.ROBOTS` are
    those of this project. The *grasp frame* lies between the finger tips: its x axis is
    the direction in which the fingers close; the hand approaches along its negative z.
    """

    name: str
    """Name in messages and recordings."""
    urdf: str
    """URDF: a path, or the name of a file in ``assets/``."""
    base: Base = "fixed"
    """Whether the base is fixed or mobile."""
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
    """Distance by which a finger opens from the middle [m]."""
    flange: str = ""
    """Link of the URDF on which the generic gripper is mounted, to which `tool` and the
    fingers then belong; "" if the robot has its own."""
    flange_axes: tuple[Vector, Vector] = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    """Directions of approach and of closing in the frame of the flange."""
    stand: bool = True
    """Whether the URDF is only an arm, to be mounted on a stand with a lift."""
    armature: tuple[float, ...]
    """Rotor inertia of the arm's joints, reflected to the joint [kg m²]."""
    root: str = "stand_base"
    """Body of the base that stands on the floor."""
    lift: str = "stand_lift"
    """Joint that sets the height of the arm."""
    sensor: str
    """First body beyond the force and torque sensor of the wrist."""
    sensor_rotation: tuple[Vector, ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    """Axes of `tool` in the frame of `sensor`, a rotation matrix."""
    forearm: str
    """Body on which a disturbance pushes."""
    head: tuple[str, Vector] = ("stand_base", (-0.19, 0.0, 1.47))
    """Body that carries the camera "head", and the camera's position [m]."""
    hand_camera: tuple[Vector, Vector, Vector]
    """Camera at the hand, frame of `tool`: position [m], its right and up axes."""
    capsules: tuple[Capsule, ...]
    """Collision geometry of a mobile robot, without its fingers."""
    stances: tuple[tuple[StanceGroup, Stance], ...] = ()
    """Stances for groups of doors."""
    content: bytes = field(default=b"", repr=False)
    """Content of the URDF when it was read: a changed file is another robot."""
    base_link: str = ""
    """Link of the URDF that is mounted on the stand; "" for its root."""
    effort: tuple[tuple[str, float], ...] = ()
    """Limits of joints that replace the URDF's [N m]."""
    velocity: tuple[tuple[str, float], ...] = ()
    """The same of speeds [rad/s]."""
    search: Callable[["RobotConfig", StanceGroup], Stance | str] | None = None
    """Returns the stance for another group of doors, or why there is none."""

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
        """Return the stance for a door; raise a ValueError if there is none."""
        group = StanceGroup.of(door, self.base)
        for doors, stance in self.stances:
            if doors == group:
                return stance
        stance_or_reason = self.search(self, group) if self.search else ""
        if isinstance(stance_or_reason, Stance):
            return stance_or_reason
        reason = f": {stance_or_reason}" if stance_or_reason else ""
        advice = '; give base="mobile"' if self.base == "fixed" else ""
        raise ValueError(
            f"the robot {self.name} has no posture for a door with "
            f"handle={door.handle!r}, swing={door.swing!r} and "
            f"hinge_side={door.hinge_side!r} on a {self.base} base{reason}{advice}"
        )


_GROUPS: Final = get_args(Base), get_args(Swing), (*get_args(Handle), "level-bar")
EVERY_GROUP: Final = tuple(
    StanceGroup(*group)
    for group in itertools.product(*_GROUPS, get_args(HingeSide)[:2])
)
"""All groups of doors that can share a stance."""


def tabulated_stances(robot: str) -> tuple[tuple[StanceGroup, Stance], ...]:
    """Return the stances of a robot from ``assets/stances.csv``; later rows override.

    "any" stands for every value of a column, "other" for everything held but a bar.
    """
    stances: dict[StanceGroup, Stance] = {}
    with asset_path("stances.csv").open(encoding="utf-8") as file:
        rows = [row for row in list(csv.reader(file))[1:] if row[0] == robot]
    for _, base, swing, held, side, *numbers, posture in rows:
        x, y, door_yaw, grasp_yaw, quarters, below, radius, height = map(float, numbers)
        held_as: Any = {"grasp_yaw": grasp_yaw, "roll": quarters * math.pi / 2}
        held_as |= {"closed_posture": tuple(map(float, posture.split()))}
        within: Any = {"below_handle": below, "radius": radius, "height": height}
        stance = Stance(handle_xy_w=(x, y), door_yaw=door_yaw, **held_as, **within)
        stances |= {
            group: stance
            for group in EVERY_GROUP
            if base in ("any", group.base)
            and swing in ("any", group.swing)
            and side in ("any", group.hinge_side)
            and held in (group.held, "other" if group.held != "bar" else "")
        }
    return tuple(stances.items())


def grasp_axes(approach: Vector, closing: Vector) -> Array:
    """Return the axes of a grasp frame as columns, (3, 3), from two unit vectors."""
    back = -np.array(approach)
    across = np.array(closing)
    return np.column_stack([across, np.cross(back, across), back])


BASE_RADIUS: Final = 0.27
"""Radius of the base's outline [m]."""
