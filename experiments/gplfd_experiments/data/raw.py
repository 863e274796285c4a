"""A motion as read from its file, and the user's settings for the file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import freeze, read_only

METRES: Final[Mapping[str, float]] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
SECONDS: Final[Mapping[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
RADIANS: Final[Mapping[str, float]] = {"rad": 1.0, "deg": math.pi / 180.0}
"""Units by name, in metres, seconds and radians."""

_USUAL_STEP: Final = (9e-4, 0.9)
"""Time between two samples of a hand [s]: 1.1 Hz to 1.1 kHz. The range spans a factor
of 1,000, as units of time do, so that at most one unit fits."""
_LISTED: Final = 30  # Largest number of names in a message.


def likely_time_unit(step: float) -> str | None:
    """Return the unit in which a step between time stamps is plausible for a hand."""
    shortest, longest = _USUAL_STEP
    fits = (unit for unit, s in SECONDS.items() if shortest <= step * s < longest)
    return next(fits, None)


Transform = tuple[float, float, float, float, float, float, float]
"""A pose as x, y, z [m] and a quaternion qw, qx, qy, qz, the scalar first."""
_NORM_TOLERANCE: Final = 0.05


def unit_transform(name: str, pose: Transform) -> tuple[float, ...]:
    """Return a pose with its quaternion normalised; the name is for messages.

    Raises:
        ValueError: It is not seven finite numbers, or the quaternion is no rotation.
    """
    norm = math.hypot(*pose[3:])
    if len(pose) != 7 or not abs(norm - 1.0) < _NORM_TOLERANCE:
        raise ValueError(
            f"{name} = {pose} must be x,y,z [m] and a unit quaternion qw,qx,qy,qz"
        )
    if not math.isfinite(sum(pose)):
        raise ValueError(f"{name} = {pose} must be finite")
    return (*pose[:3], *(part / norm for part in pose[3:]))


@dataclass(frozen=True, kw_only=True, slots=True)
class WrenchSensor:
    """Properties of recorded forces and moments.

    The defaults describe a sensor between the arm and the hand of a robot, published as
    a ROS WrenchStamped: the wrench of the environment on the hand, in the axes of the
    hand and about its origin, without bias and without the weight of the hand.

    Raises:
        ValueError: A value is outside its range.
    """

    acts_on: Literal["hand", "object"] = "hand"
    """Whether the wrench is that of the environment on the hand, or the opposite one,
    of the hand on the object."""
    axes: Literal["hand", "recorded"] = "hand"
    """Axes of force and moment: of the sensor, which moves with the hand, or of the
    frame in which the poses were recorded."""
    pose: Transform = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    """Pose of the sensor in the frame of the recorded hand; moments are about its
    origin."""
    rest: float = 0.0
    """Time at the start of a recording without contact of the hand [s]. The mean wrench
    in this time minus the tool's weight is the sensor's bias; 0 for no bias."""
    tool_weight: float = 0.0
    """Weight of the tool on the sensor [N]."""
    tool_centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass of the tool, in the frame of the sensor [m]."""
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Direction of gravity in the frame in which the poses were recorded."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", unit_transform("force sensor", self.pose))
        if self.acts_on not in ("hand", "object"):
            raise ValueError(f"forces on {self.acts_on!r} must be on hand or object")
        if self.axes not in ("hand", "recorded"):
            raise ValueError(f"axes {self.axes!r} of forces must be hand or recorded")
        if self.axes == "recorded" and any(self.pose[4:]):
            raise ValueError(
                "the sensor is turned in the hand, and its forces are in the axes of "
                "the recorded poses; give its position alone, x,y,z,1,0,0,0"
            )
        for name, number in (("rest", self.rest), ("tool weight", self.tool_weight)):
            if not 0.0 <= number < math.inf:
                raise ValueError(f"{name} = {number:g} must be 0 or positive")
        for name in ("tool_centre", "gravity"):
            vector = getattr(self, name)
            if len(vector) != 3 or not math.isfinite(sum(vector)):
                raise ValueError(f"{name} = {vector} must be three numbers x,y,z")
        if not any(self.gravity):
            raise ValueError("gravity = 0,0,0 has no direction; 0,0,-1 is downwards")


OBSERVED: Final = WrenchSensor(axes="recorded")
"""Wrenches as the environment observes them: on the hand, in the frame of the poses."""
DEMONSTRATED: Final = WrenchSensor(axes="recorded", acts_on="object")
"""Wrenches as in a `Demonstration`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RawRecording:
    """One motion of a hand as read from a file, before any check of its usability.

    Samples may be missing (NaN), repeated, out of order and in any unit;
    `gplfd_experiments.data.preparation` repairs and reports this.

    Raises:
        ValueError: The shapes do not belong together, there are fewer than two
            samples, or the unit is unknown.
    """

    name: str
    """Origin: the file, and the part of it."""
    positions: FloatArray
    """Positions of the hand, (N, 3), in `unit`."""
    unit: str | None
    """One of `METRES`; None if the file states none."""
    times: FloatArray | None = None
    """Time stamps [s], (N,); None if the file has none."""
    quaternions: FloatArray | None = None
    """Quaternions, scalar first, of any sign and norm, (N, 4); or none."""
    wrenches: FloatArray | None = None
    """Forces and moments [N, N m], (N, 6); or none."""
    sensor: WrenchSensor | None = None
    """How the wrenches were recorded; None if the file does not state it."""
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    """Other arrays, (N, d), such as "gripper"."""
    untimed: str = ""
    """Hint at possible times in a file without times; continues a message."""
    notes: tuple[str, ...] = ()
    """Notes of the reader of the file."""

    def __post_init__(self) -> None:
        for name in ("positions", "times", "quaternions", "wrenches"):
            if getattr(self, name) is not None:
                freeze(self, name)
        signals = {name: read_only(array) for name, array in self.signals.items()}
        object.__setattr__(self, "signals", signals)
        rows = len(self.positions) if self.positions.ndim else 0
        expected = {
            "positions": (self.positions, (rows, 3)),
            "times": (self.times, (rows,)),
            "quaternions": (self.quaternions, (rows, 4)),
            "wrenches": (self.wrenches, (rows, 6)),
            **{name: (a, (rows, *a.shape[1:2])) for name, a in signals.items()},
        }
        for name, (array, shape) in expected.items():
            if array is not None and (array.shape != shape or len(shape) > 2):
                raise ValueError(
                    f"{self.name}: {name} must have shape {shape}, got {array.shape}"
                )
        if rows < 2:
            raise ValueError(
                f"{self.name} has {rows} samples; a motion needs at least two"
            )
        if self.unit is not None and self.unit not in METRES:
            raise ValueError(
                f"{self.name}: unknown unit of length {self.unit!r:.40}; known are "
                f"{', '.join(METRES)}"
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class Selection:
    """What to read from a file, and how to interpret it.

    Raises:
        ValueError: A unit or an order is unknown, or a rate is not positive.
    """

    body: str | None = None
    """Moving object: a segment, joint, marker, topic or array of the file."""
    columns: tuple[str, ...] = ()
    """Names of the columns of a table, in order, see `readers.tables`."""
    units: str | None = None
    """Unit of the positions, one of `METRES`; overrides the unit in the file."""
    time_unit: str | None = None
    """Unit of time stamps, one of `SECONDS`; overrides the unit in the file."""
    angles: str = "rad"
    """Unit of rotation vectors without one, one of `RADIANS`."""
    wrench: str | None = None
    """Source of the forces: a topic, feature or observation of the file."""
    quaternions: Literal["wxyz", "xyzw"] | None = None
    """Order of quaternion components without names."""
    recorded_rate: float | None = None
    """Samples per second of a file without time stamps [Hz]."""
    urdf: Path | None = None
    """Description of the robot whose joints were recorded."""
    link: str | None = None
    """Link of this robot that is the hand."""

    def __post_init__(self) -> None:
        for option, value, known in (
            ("--units", self.units, METRES),
            ("--time-unit", self.time_unit, SECONDS),
            ("--angles", self.angles, RADIANS),
            ("--quaternions", self.quaternions, ("wxyz", "xyzw")),
        ):
            if value is not None and value not in known:
                raise ValueError(
                    f"{option} {value!r} must be one of {', '.join(known)}"
                )
        rate = self.recorded_rate
        if rate is not None and not 0.0 < rate < math.inf:
            raise ValueError(f"--recorded-rate {rate} must be a positive number [Hz]")


FrameName = Literal["first-pose", "recorded", "hinge"]
Segments = Literal["none", "rests", "turns"] | tuple[tuple[float, float], ...]

_GREATEST: Final = 1e5  # Largest rate or cut-off [Hz], and largest gap [s].


@dataclass(frozen=True, kw_only=True, slots=True)
class Preparation:
    """Settings of `prepare`; the defaults suit a hand recorded at 50 Hz or more.

    Raises:
        ValueError: A value is outside its range, or a transform is not a pose.
    """

    units: str | None = None
    """Unit of the recorded positions; None for the unit in the file, else metres."""
    offset: Transform | None = None
    """Pose of the moved object in the recorded frame, for example of the handle in the
    frame of a glove's tracker."""
    sensor: WrenchSensor = WrenchSensor()
    """How forces were recorded, if the file does not state it."""
    frame: FrameName | Transform = "first-pose"
    """Frame of the result: each motion's first pose, the recorded frame, the frame of a
    door with a hinge estimated from the motion, or a pose in the recorded frame."""
    segments: Segments = "none"
    """Repetitions in a motion: the whole motion, the motions between rests or turns
    without motions back, or start and end of each since the first sample [s]."""
    trim_rests: bool = True
    """Whether rests at both ends are cut to those of a gentle motion."""
    cutoff: float | None = 10.0
    """Cut-off of the low-pass filter [Hz], which runs forwards and backwards, without
    delay; None for no filter. People move their hands at less than 5 Hz."""
    rate: float | None = 100.0
    """Samples per second of the result [Hz]; None for the samples as recorded."""
    largest_gap: float = 0.5
    """Longest gap between samples that is interpolated linearly [s]."""

    def __post_init__(self) -> None:
        for name in ("cutoff", "rate", "largest_gap"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value <= _GREATEST:
                raise ValueError(
                    f"{name} = {value:g} must be a positive number to {_GREATEST:g}"
                )
        for name in ("offset", "frame"):
            pose = getattr(self, name)
            if pose is not None and not isinstance(pose, str):
                object.__setattr__(self, name, unit_transform(name, pose))
        frames = get_args(FrameName)
        if isinstance(self.frame, str) and self.frame not in frames:
            raise ValueError(
                f"frame {self.frame!r} must be one of {', '.join(frames)}, or a pose "
                "x,y,z,qw,qx,qy,qz"
            )
        if isinstance(self.segments, str):
            if self.segments not in ("none", "rests", "turns"):
                raise ValueError(
                    f"segments {self.segments!r} must be none, rests, turns, or times "
                    "such as 1.5-4.2,6-9.5 [s]"
                )
            return
        for start, end in self.segments:
            if not start < end:
                raise ValueError(f"a segment from {start} to {end} s ends too early")


def chosen(
    wanted: str | None, known: dict[str, Any], what: str, *, file: str
) -> tuple[str, Any]:
    """Return the selected item of a file, or the only one.

    Raises:
        ValueError: There is none, none of that name, or several without a selection.
    """
    if not known:
        raise ValueError(f"{file} has no {what}")
    names = ", ".join(sorted(known)[:_LISTED]) + (", …" if len(known) > _LISTED else "")
    if wanted is None:
        if len(known) > 1:
            raise ValueError(
                f"{file} has more than one {what}; choose with --body: {names}"
            )
        (wanted,) = known
    if wanted not in known:
        hint = nearest_name(wanted, known)
        raise ValueError(f"{file} has no {what} {wanted!r}{hint}; it has {names}")
    return wanted, known[wanted]
