"""External disturbances of robot and door during an episode.

Every number may also be a pair ``(low, high)``, from which each reset draws it. A
disturbance begins once its start time has passed and the door is open by its angle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

from gplfd_env.doors.presets import preset_table
from gplfd_env.validation.fields import Quantities, choice, draw_ranges, quantity
from gplfd_env.validation.named import preset, record_of

NumberOrRange = Any
"""A number, or the range (low, high) from which every episode draws it."""
Target = Literal["hand", "forearm", "door"]
"""What a push acts on."""
HeldByPerson = Literal["hand", "door"]
"""What a person holds or stands in the way of."""
Profile = Literal["half_sine", "constant"]
"""How a push grows and fades."""


def _number(default: float, **allowed: Any) -> Any:
    """Declare a number, or a range from which it is drawn."""
    return quantity(default, pairs=True, **allowed)


_ANGLES: Final[Any] = {"unit": "rad", "low": 0.0, "high": math.radians(95.0)}
_FORCES: Final[Any] = {"unit": "N", "low": -100.0, "high": 100.0}
_TIMES: Final[Any] = {"unit": "s", "low": 0.0, "high": 1000.0}
_DURATIONS: Final[Any] = {"unit": "s", "above": 0.0, "high": 1000.0}


@dataclass(frozen=True, kw_only=True, slots=True)
class Push(Quantities):
    """A force on hand, forearm or leaf, in the axes of the handle's circle."""

    on: Target = choice("hand", Target)
    """Where the push acts: ``"hand"`` and ``"forearm"`` at their centres of mass;
    ``"door"`` at the handle, where only `along` has an effect."""
    profile: Profile = choice("half_sine", Profile)
    """``"half_sine"``, or ``"constant"``."""
    along: NumberOrRange = _number(0.0, **_FORCES)
    """Greatest force along the opening motion."""
    outward: NumberOrRange = _number(0.0, **_FORCES)
    """Greatest force away from the hinge."""
    upward: NumberOrRange = _number(0.0, **_FORCES)
    """Greatest force upwards."""
    start_angle: NumberOrRange = _number(0.0, **_ANGLES)
    """It begins when the door is open by this angle."""
    start_time: NumberOrRange = _number(0.0, **_TIMES)
    """It begins this long after the reset."""
    duration: NumberOrRange = _number(0.3, **_DURATIONS)
    """How long it lasts."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Person(Quantities):
    """A person holds the robot's hand or the door, or blocks its way with a hand.

    A mass, the person's hand, touches hand or door through the contact stiffness of
    ISO/TS 15066 (hands and fingers: 0.6 kg, 75 N/mm). A softer spring-damper, the arm,
    ties it to where it took hold. It moves along the handle's circle only.
    """

    on: HeldByPerson = choice("hand", HeldByPerson)
    """What is held: the robot's hand or the door at its handle."""
    one_sided: bool = choice(False, Literal[False, True])
    """Whether the person only stands in the way and never pulls."""
    start_angle: NumberOrRange = _number(0.0, **_ANGLES)
    """Angle at which the person takes hold, or at which the blocking hand is."""
    start_time: NumberOrRange = _number(0.0, **_TIMES)
    """Earliest time at which the person takes hold."""
    duration: NumberOrRange = _number(2.5, **_DURATIONS)
    """From taking hold, or the first touch, to letting go."""
    hand_mass: NumberOrRange = _number(0.6, unit="kg", low=0.1, high=5.0)
    """Mass of the person's hand."""
    contact_stiffness: NumberOrRange = _number(75e3, unit="N/m", low=1e3, high=100e3)
    """Contact stiffness between the person's hand and what it touches."""
    contact_damping: NumberOrRange = _number(80.0, unit="N s/m", low=0.0, high=400.0)
    """Contact damping between the person's hand and what it touches."""
    arm_stiffness: NumberOrRange = _number(1000.0, unit="N/m", low=0.0, high=5000.0)
    """Stiffness of the person's arm."""
    arm_damping: NumberOrRange = _number(50.0, unit="N s/m", low=0.0, high=200.0)
    """Damping of the person's arm."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Stop(Quantities):
    """The door does not open further, because somebody is behind it or it is locked."""

    angle: NumberOrRange = _number(0.0, unit="rad", low=0.0, high=math.radians(95.0))
    """Greatest opening angle while the stop acts; 0 is a locked door."""
    duration: NumberOrRange = _number(1000.0, **_DURATIONS)
    """From the door's first contact (within half a degree) until it is free."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Bump(Quantities):
    """The robot's base is moved, and its task frame with it; the robot does not know.

    Commanded poses are displaced relative to the door, and the observed pose and twist
    of the hand are wrong by it. Inertia and the arm's change of posture are not
    modelled.
    """

    forward: NumberOrRange = _number(0.0, unit="m", low=-0.05, high=0.05)
    """Permanent displacement along the base's x axis."""
    left: NumberOrRange = _number(0.0, unit="m", low=-0.05, high=0.05)
    """Permanent displacement along the base's y axis."""
    start_angle: NumberOrRange = _number(0.0, **_ANGLES)
    """It begins when the door is open by this angle."""
    start_time: NumberOrRange = _number(0.0, **_TIMES)
    """It begins this long after the reset."""
    duration: NumberOrRange = _number(0.3, **_DURATIONS)
    """How long the base moves (a minimum-jerk motion)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Breakaway(Quantities):
    """A hinge that sticks before it first moves, and a seal near the frame."""

    stiction: NumberOrRange = _number(0.0, unit="N m", low=0.0, high=50.0)
    """Additional friction of the hinge until the door has moved by half a degree."""
    seal: NumberOrRange = _number(0.0, unit="N m", low=0.0, high=50.0)
    """Closing torque of the seal at the closed door; zero at `seal_angle`."""
    seal_angle: NumberOrRange = _number(
        math.radians(4.0), unit="rad", low=math.radians(0.5), high=math.radians(15.0)
    )
    """Where the leaf leaves the seal."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Disturbance:
    """External events of an episode; None means no event of this kind.

    A field may be given as a mapping of its record's fields. Raises a ValueError for an
    unknown key or a value not allowed, a TypeError for a value of a wrong kind.
    """

    push: Push | None = None
    """A force for a while."""
    person: Person | None = None
    """A person holds on or is in the way."""
    stop: Stop | None = None
    """The door is blocked."""
    bump: Bump | None = None
    """The base is moved."""
    breakaway: Breakaway | None = None
    """The hinge sticks at the start."""

    def __post_init__(self) -> None:
        for name, record in CAUSES.items():
            value = getattr(self, name)
            if value is not None:
                cause = record_of(value, record, f"disturbance {name}")
                object.__setattr__(self, name, cause)

    @property
    def idle(self) -> bool:
        """Whether there is no disturbance."""
        return self == Disturbance()

    def drawn(self, rng: np.random.Generator) -> Disturbance:
        """Return the disturbance of an episode; fixed numbers draw, too."""
        causes = {name: getattr(self, name) for name in CAUSES}
        drawn = {n: draw_ranges(cause, rng) for n, cause in causes.items() if cause}
        return dataclasses.replace(self, **drawn)


CAUSES: Final[Mapping[str, Any]] = MappingProxyType(
    {"push": Push, "person": Person, "stop": Stop, "bump": Bump, "breakaway": Breakaway}
)
"""Record of each field of `Disturbance`, by its name."""

DISTURBANCES: Final = MappingProxyType(preset_table("disturbances", Disturbance()))
"""Presets for ordinary doors, one kind of event each."""

DisturbanceSpec = str | Mapping[str, Any] | Disturbance
"""What `disturbance_named` accepts."""


def disturbance_named(spec: DisturbanceSpec) -> Disturbance:
    """Return the disturbance of a preset's name, a mapping of fields, or a record.

    A mapping starts from its ``"preset"``, also within its records (``{"preset":
    "push", "push": {"duration": 0.5}}``). Raises a ValueError for an unknown preset or
    field, or a value not allowed, a TypeError for anything else.
    """
    return preset(spec, DISTURBANCES, "none", "disturbance")
