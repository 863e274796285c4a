"""Configuration of a door, and presets by name."""

import dataclasses
import math
import numbers
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

from gplfd_env.doors import hardware
from gplfd_env.doors.parts import Closer, Leaf, Lockset, Mechanism
from gplfd_env.doors.presets import preset_table
from gplfd_env.validation.fields import (
    allowed_range,
    check_quantities,
    choice,
    quantity,
)
from gplfd_env.validation.named import changed_fields, preset, record_of, with_fields

Handle = Literal["bar", "lever", "knob", "paddle", "touch-bar", "handleset"]
"""What the hand holds: a vertical bar, a horizontal lever or a round knob on an axis
normal to the leaf, or a part on a horizontal axis in it
(`gplfd_env.doors.geometry`)."""
Latch = Literal["none", "spring"]
"""Whether a sprung bolt holds the closed door until the handle is turned."""
Swing = Literal["pull", "push"]
"""Whether the robot pulls or pushes the door open."""
HingeSide = Literal["right", "left", "bottom", "top"]
"""Side of the hinge, seen from the robot; for a sliding or folding leaf, the side to
which it moves."""

Motion = Literal[
    "hinged", "sliding", "parallel-sliding", "folding", "flap", "rising-butt",
    "concealed-hinge",
]  # fmt: skip
"""How the leaf moves, see `gplfd_env.doors.motion`."""


class MotionRules(NamedTuple):
    """What a motion of the leaf allows."""

    upright_hinge: bool = False  # It turns about one: a fixed base can follow it.
    level: bool = False  # Hinge and bar are level.
    all_handles: bool = False  # Else only a bar.
    pushed: bool = False  # Whether it also opens by pushing.
    mechanism: tuple[str, ...] = ()  # Fields of `Mechanism` that apply to it.


MOTIONS: Final[Mapping[Motion, MotionRules]] = MappingProxyType(
    {
        "hinged": MotionRules(upright_hinge=True, all_handles=True, pushed=True),
        "sliding": MotionRules(mechanism=("clear_width",)),
        "parallel-sliding": MotionRules(mechanism=("clear_width", "offset")),
        "folding": MotionRules(mechanism=("roller_friction",)),
        "flap": MotionRules(
            level=True, mechanism=("strut_stiffness", "strut_dead_angle")
        ),
        "rising-butt": MotionRules(
            upright_hinge=True, all_handles=True, pushed=True, mechanism=("rise",)
        ),
        "concealed-hinge": MotionRules(upright_hinge=True),
    }
)
"""Rules of every motion; `gplfd_env.doors.motion.links_of` has its joints."""

OVERHANG: Final = 0.01
"""Distance by which the leaf extends beyond the hinge axis if no width is given [m]."""
BAR_RADIUS: Final = 0.011
"""Radius of bar and lever [m]."""
KNOB_RADIUS: Final = 0.026
"""Radius of the knob [m]."""

# Tolerance between width - backset and radius of a leaf [m].
_DISAGREEMENT: Final = 0.02


def held_radius(handle: Handle) -> float:
    """Return half of the distance between fingers that hold a handle [m]."""
    return KNOB_RADIUS if handle == "knob" else BAR_RADIUS


class Turning(NamedTuple):
    """Defaults of a handle that turns, for fields of `Lockset` that are None."""

    preload: float  # Torque of the return spring at rest [N m].
    stiffness: float  # Its stiffness [N m/rad].
    travel: float = 0.8  # Angle at which the handle meets its stop [rad].
    arm: float = 0.0  # Distance from a horizontal axis in the leaf to the hand [m].


TURNING: Final[Mapping[str, Turning]] = MappingProxyType(
    {
        "lever": Turning(0.5, 1.2),
        "knob": Turning(0.175, 0.2),
        "paddle": Turning(1.5, 1.5, 0.40, 0.09),
        "touch-bar": Turning(0.9, 3.0, 0.32, 0.05),
        "handleset": Turning(0.5, 1.2, 0.35, 0.05),
    }
)
"""Levers and knobs: the middle of the ranges of `standard_door`; others:
assets/README.md."""


_LEAF, _LOCKSET, _CLOSER, _MECHANISM = Leaf(), Lockset(), Closer(), Mechanism()


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorConfig:
    """A door, by default hinged.

    The hinge axis lies in the handle's plane, so the handle moves on a circle of
    ``radius`` about it and first moves straight out of the frame, or into it. If the
    leaf does not turn about a hinge, torques stand for forces that do the same work per
    rad of `door_angle` (`gplfd_env.doors.motion`). A part may be given as a mapping of
    its record's fields, such as ``closer={"preload": 5.0}``; `gplfd_env.doors.hardware`
    computes parts from the standards.

    Raises a ValueError if a field is unknown or outside its range, or fields disagree,
    a TypeError if a value is of a wrong kind.
    """

    radius: float = quantity(
        0.50, unit="m", low=0.30, high=1.05, reason="radii that the robot can open"
    )
    """Distance from hinge axis to handle axis; of a sliding or folding leaf, from the
    handle to the jamb to which it moves."""
    hinge_friction: float = quantity(0.5, unit="N m", low=0.0, high=50.0)
    """Coulomb friction of the hinge."""
    hinge_damping: float = quantity(0.5, unit="N m s/rad", low=0.0, high=50.0)
    """Viscous friction of the hinge."""
    panel_mass: float = quantity(12.0, unit="kg", low=1.0, high=100.0)
    """Mass of the door leaf."""
    handle_height: float = quantity(
        0.85, unit="m", low=0.50, high=1.22, reason="reach of torso and arm"
    )
    """Height of the grasped point above the floor."""
    stop_angle: float = quantity(
        math.radians(100.0), unit="rad", low=math.radians(30.0), high=math.pi
    )
    """Angle at which the leaf meets its stop."""
    stiction: float = quantity(0.0, unit="N m", low=0.0, high=50.0)
    """Torque that keeps the door closed; falls to zero at 0.5°."""
    seal: float = quantity(0.0, unit="N m", low=0.0, high=20.0)
    """Closing torque of the seal at the closed door."""
    seal_angle: float = quantity(
        math.radians(4.0), unit="rad", low=math.radians(0.5), high=math.radians(15.0)
    )
    """Angle at which the seal's torque, which falls linearly, reaches zero."""
    handle: Handle = choice("bar", Handle)
    """What the hand holds."""
    latch: Latch = choice("none", Latch)
    """What holds the closed door."""
    swing: Swing = choice("pull", Swing)
    """Whether the robot pulls or pushes the door open."""
    hinge_side: HingeSide = choice("right", HingeSide)
    """Side of the hinge, seen from the robot."""
    motion: Motion = choice("hinged", Motion)
    """How the leaf moves."""
    leaf: Leaf = _LEAF
    """Dimensions of the leaf."""
    lockset: Lockset = _LOCKSET
    """Handle that turns, and bolt."""
    closer: Closer = _CLOSER
    """Door closer; by default none."""
    mechanism: Mechanism = _MECHANISM
    """Dimensions of a leaf that does not only turn about its hinge."""

    def __post_init__(self) -> None:
        check_quantities(self)
        for name, record in _PARTS.items():
            part = record_of(getattr(self, name), record, f"DoorConfig.{name}")
            object.__setattr__(self, name, part)
        problem = self._contradiction()
        if problem:
            raise ValueError(f"no such door: {problem}")

    def _contradiction(self) -> str:
        """Return a message about contradictory fields; empty if there are none."""
        motion, leaf, lockset = self.motion, self.leaf, self.lockset
        rules = MOTIONS[motion]
        for name in changed_fields(self.mechanism):
            if name not in rules.mechanism:
                motions = (x for x in MOTIONS if name in MOTIONS[x].mechanism)
                return f"mechanism.{name} is a field of motion = {' or '.join(motions)}"
        if rules.level != (self.hinge_side in ("bottom", "top")):
            return (
                f"motion = {motion!r} with hinge_side = {self.hinge_side!r}; a flap "
                "has its hinge at the bottom or top, all others on the right or left"
            )
        if self.handle != "bar" and not rules.all_handles:
            return f"motion = {motion!r} with handle = {self.handle!r}; choose 'bar'"
        if self.swing == "push" and not rules.pushed:
            return f"motion = {motion!r} with swing = 'push'; choose swing = 'pull'"
        if self.latch == "spring" and self.handle == "bar":
            return (
                "latch = 'spring' with handle = 'bar', which does not turn; choose "
                "handle = 'lever' or 'knob'"
            )
        if self.handle == "touch-bar" and self.swing == "pull":
            return (
                "handle = 'touch-bar' with swing = 'pull': it must be pushed; choose "
                "swing = 'push', or handle = 'bar' for the pull on its other side"
            )
        if abs(self.overhang) > _DISAGREEMENT:
            return (
                f"leaf.width = {leaf.width:g} minus leaf.backset = {leaf.backset:g} is "
                f"not radius = {self.radius:g} within {_DISAGREEMENT:g} m"
            )
        if lockset.dead_travel > 0.5 * self.handle_travel:
            return (
                f"lockset.dead_travel = {lockset.dead_travel:g} is more than half of "
                f"handle_travel = {self.handle_travel:g}"
            )
        return ""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields that differ from their default, parts as mappings."""
        return changed_fields(self)

    def replaced(self, fields: Mapping[str, Any]) -> "DoorConfig":
        """Return the door with changed fields; a new radius resets its leaf's width."""
        door = self
        if "radius" in fields:
            leaf = dataclasses.replace(door.leaf, width=None)
            door = dataclasses.replace(door, radius=fields["radius"], leaf=leaf)
        return with_fields(door, fields, "door")

    @property
    def hand_offset(self) -> float:
        """Distance from the handle's axis to the hand, towards the hinge [m]."""
        return self.lockset.handle_length - 0.03 if self.handle == "lever" else 0.0

    def _lockset(self, field: str) -> float:
        """Return a field of the lockset; typical of the handle if it is None."""
        usual = TURNING["lever" if self.handle == "bar" else self.handle]
        value = getattr(self.lockset, f"handle_{field}")
        return float(getattr(usual, field) if value is None else value)

    @property
    def handle_spring(self) -> tuple[float, float]:
        """Preload [N m] and stiffness [N m/rad] of the handle's return spring."""
        return self._lockset("preload"), self._lockset("stiffness")

    @property
    def handle_travel(self) -> float:
        """Angle at which the handle meets its stop [rad]."""
        return self._lockset("travel")

    @property
    def handle_arm(self) -> float:
        """Distance from axis to hand of a paddle, touch bar or handleset [m]."""
        return self._lockset("arm")

    @property
    def hand_radius(self) -> float:
        """Distance from hinge axis to hand [m]."""
        return self.radius - self.hand_offset

    @property
    def kind(self) -> dict[str, str]:
        """The fields that decide which motion opens it; no `motion` if it is hinged."""
        kind = {name: getattr(self, name) for name in _KIND}
        return {n: value for n, value in kind.items() if value != "hinged"}

    @property
    def level(self) -> bool:
        """Whether hinge and bar are level, as of a flap; else they are upright."""
        return MOTIONS[self.motion].level

    @property
    def hinge_sign(self) -> float:
        """-1 if the hinge is on the left, else 1."""
        return -1.0 if self.hinge_side == "left" else 1.0

    @property
    def swing_sign(self) -> float:
        """Direction in which the handle begins to move: 1 along x, -1 against it."""
        return 1.0 if self.swing == "pull" else -1.0

    @property
    def clear_width(self) -> float:
        """Travel of a sliding leaf [m]."""
        width = self.mechanism.clear_width
        return self.radius if width is None else width

    @property
    def fold_distance(self) -> float:
        """Distance from the handle to the joint between equal folding leaves [m]."""
        return (self.radius - self.leaf.backset) / 2.0

    @property
    def overhang(self) -> float:
        """Distance by which the leaf extends beyond the hinge axis [m]."""
        if self.leaf.width is None:
            return OVERHANG
        return self.leaf.width - self.leaf.backset - self.radius

    @property
    def closing_spring(self) -> tuple[float, float]:
        """Lasting closing torque [N m] and stiffness [N m/rad] of closer and strut."""
        strut, dead = self.mechanism.strut_stiffness, self.mechanism.strut_dead_angle
        return self.closer.preload + strut * dead, self.closer.stiffness - strut

    @property
    def friction(self) -> float:
        """Coulomb friction of hinge and closer [N m]."""
        return self.hinge_friction + self.closer.friction


_PARTS: Final[Mapping[str, type[Leaf | Lockset | Closer | Mechanism]]] = {
    "leaf": Leaf, "lockset": Lockset, "closer": Closer, "mechanism": Mechanism,
}  # fmt: skip
_KIND: Final = ("handle", "latch", "swing", "hinge_side", "motion")


def _room(
    width: float, construction: str = "tubular-strips", **parts: Any
) -> DoorConfig:
    """Return a door by DIN 18101, with a lever and a latch."""
    fields = hardware.leaf(width, construction) | parts
    kind: dict[str, Any] = {"handle": "lever", "latch": "spring"}
    return DoorConfig(handle_height=1.05, seal=1.5, hinge_damping=0.2, **kind, **fields)


DOORS: Final[Mapping[str, DoorConfig]] = MappingProxyType(
    preset_table("doors", DoorConfig())
    | {
        "room-584": _room(0.584, "honeycomb"),
        "room-709": _room(0.709, "honeycomb"),
        "room-834": _room(0.834),
        "room-959": _room(0.959, "tubular-core"),
        "office-closer-2": _room(0.834, "tubular-core", closer=hardware.en1154(2)),
        "heavy-fire": _room(
            0.959, "fire", closer=hardware.en1154(4), lockset=Lockset(bolt_preload=8.0)
        ),
        "barn-door": DoorConfig(
            motion="sliding",
            radius=0.82,
            leaf=Leaf(thickness=0.045),
            **hardware.rollers(40.0, 0.82),
        ),
        "pocket-door": DoorConfig(
            motion="sliding",
            radius=0.68,
            hinge_side="left",
            **hardware.rollers(20.0, 0.68, 0.02, soft_close=8.0),
        ),
        "plug-door": DoorConfig(
            motion="parallel-sliding",
            radius=0.75,
            mechanism=Mechanism(offset=0.06),
            leaf=Leaf(thickness=0.07),
            **hardware.rollers(45.0, 0.75, 0.006),
        ),
        "rising-butt": DoorConfig(
            motion="rising-butt", **hardware.leaf(0.762, "tubular-core", backset=0.06)
        ),
    }
)
"""Small, medium and large are demonstrated; heavy is a medium door that needs 14 N. The
others are doors of furniture and of buildings; the last ones are not hinged."""

DoorSpec = str | float | Mapping[str, Any] | DoorConfig
"""What `door_config` accepts."""


def door_config(door: DoorSpec) -> DoorConfig:
    """Return the door of a preset's name, a radius [m], a mapping or a record.

    A mapping of fields starts from its ``"preset"`` (``{"preset": "medium", "closer":
    {"preload": 5.0}}``). Raises a ValueError for an unknown preset or field, or a value
    outside its range, a TypeError for anything else.
    """
    if isinstance(door, numbers.Real) and not isinstance(door, bool):
        return DoorConfig(radius=door)  # type: ignore[arg-type]
    radii = allowed_range(DoorConfig, "radius")
    return preset(door, DOORS, "medium", "door", "a radius in metres", radii)
