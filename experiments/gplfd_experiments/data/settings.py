"""Settings of reading and preparing motion files, and units; fast, for ``--help``."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import tyro

METRES: Final[Mapping[str, float]] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
SECONDS: Final[Mapping[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
RADIANS: Final[Mapping[str, float]] = {"rad": 1.0, "deg": math.pi / 180.0}
"""Units by name, in metres, seconds and radians."""
POSE: Final = "x,y,z,qw,qx,qy,qz"
_FRAMES: Final = ("first-pose", "recorded", "hinge")
_CHOICES: Final[Mapping[str, tuple[str | None, ...]]] = {
    "units": (None, *METRES),
    "time_unit": (None, *SECONDS),
    "quaternions": (None, "wxyz", "xyzw"),
    "force_on": ("hand", "object"),
    "force_axes": ("hand", "recorded"),
}
_ANGLES: Final = re.compile(
    r"(rad|deg)|euler-((?!.*(.)\3)(?:[xyz]{3}|[XYZ]{3}))(?:-(rad|deg))?"
)
_NORM_TOLERANCE: Final = 0.05  # Largest error of the norm of a rotation's quaternion.
_NUMBERS: Final[Mapping[str, tuple[str, float]]] = {
    "recorded_rate": ("Hz", 1e-5),
    "force_rest": ("s", 0.0),
    "tool_weight": ("N", 0.0),
    "cutoff": ("Hz", 0.0),
    "rate": ("Hz", 0.0),
    "largest_gap": ("s", 1e-5),
}
"""Units of numbers, and their least values."""
_USUAL_STEP: Final = (9e-4, 0.9)
"""Time between two samples of a hand [s]: 1.1 Hz to 1.1 kHz. The range spans a factor
of 1,000, as units of time do, so that at most one unit fits."""


def likely_time_unit(step: float) -> str | None:
    """Return the unit in which a step between time stamps is plausible for a hand."""
    shortest, longest = _USUAL_STEP
    fits = (unit for unit, s in SECONDS.items() if shortest <= step * s < longest)
    return next(fits, None)


def angles_of(text: str | None) -> tuple[str | None, str | None]:
    """Return the sequence of Euler angles and the unit of `ImportSettings.angles`."""
    match = _ANGLES.fullmatch(text or "rad")
    if match is None:
        raise ValueError(
            f"angles {text!r} must be rad, deg, or Euler angles such as euler-xyz, "
            "about fixed axes, euler-ZYX, about those of the hand, and euler-xyz-deg"
        )
    return match[2], (match[1] or match[4]) if text else None


def of_text(metavar: str, read: Callable[[str], Any]) -> Any:
    """Return how a value is read from one argument of the command line."""

    def written(value: Any) -> list[str]:
        plain = value is None or isinstance(value, str)
        return [str(value) if plain else ",".join(f"{part:g}" for part in value)]

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda words: read(words[0]),
        is_instance=lambda value: True,
        str_from_instance=written,
    )


def numbers(names: str) -> Callable[[str], Any]:
    """Return a function that reads numbers of these names, and leaves other texts."""

    def read(text: str) -> Any:
        try:
            values = tuple(map(float, text.split(",")))
        except ValueError:
            return text
        return values if len(values) == len(names.split(",")) else text

    return read


_COLUMNS: Final = of_text("t,x,y,z,...", lambda s: tuple(map(str.strip, s.split(","))))


def _segments(text: str) -> Any:
    try:
        parts = [part.split("-") for part in text.split(",")]
        return tuple((float(start), float(end)) for start, end in parts)
    except ValueError:
        return text


PoseNumbers = tuple[float, ...]
"""x, y, z [m] and a quaternion qw, qx, qy, qz, the scalar first."""
Segments = Literal["none", "rests"] | tuple[tuple[float, float], ...]
_Pose = Annotated[PoseNumbers, of_text("POSE", numbers(POSE))]
_Vector = Annotated[tuple[float, ...], of_text("X,Y,Z", numbers("x,y,z"))]
_Name = Annotated[str | None, tyro.conf.arg(metavar="NAME")]
_Hertz = Annotated[float, tyro.conf.arg(metavar="HZ")]
_Seconds = Annotated[float, tyro.conf.arg(metavar="S")]


@dataclass(frozen=True, kw_only=True, slots=True)
class ImportSettings:
    """What is read from motion files, what they do not state, and how it is prepared.

    The defaults suit a hand recorded at 50 Hz or more.
    """

    body: _Name = None
    """Moving object: a segment, joint, one or three markers, topic, or array."""
    columns: Annotated[tuple[str, ...], _COLUMNS] = ()
    """Names of the columns of a table without a header, in order, with - for a column
    to ignore, or NAME=HEAD for some of a header or of arrays; known names are t, x, y,
    z, qw, qx, qy, qz, rx, ry, rz, roll, pitch, yaw, r00, ..., fx, ..., gripper."""
    units: Literal["m", "cm", "mm", "in"] | None = None
    """Unit of positions; default: the unit in the file, or metres."""
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    """Unit of times in tables and arrays; overrides the unit in the file. Default: that
    unit, or seconds."""
    angles: Annotated[str | None, tyro.conf.arg(metavar="rad|deg|euler-xyz[-deg]")] = (
        None
    )
    """Unit of rotation vectors and Euler angles; overrides the unit in the file.
    Default: that unit, or radians. With euler-, angles are about these axes, in any
    order of SciPy: euler-xyz about fixed axes, euler-ZYX about those of the hand."""
    quaternions: Literal["wxyz", "xyzw"] | None = None
    """Order of quaternion components without names."""
    recorded_rate: Annotated[float | None, tyro.conf.arg(metavar="HZ")] = None
    """Samples per second of recordings without time stamps."""
    urdf: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Robot whose joint states were recorded."""
    link: _Name = None
    """Link of this robot that is the hand."""
    wrench: _Name = None
    """Source of the forces: a topic of WrenchStamped, a feature or an observation."""
    force_on: Literal["hand", "object"] = "hand"
    """Recorded forces are those of the environment on the hand, or of the hand on the
    object. Data sets of gplfd contain this and all following force options."""
    force_axes: Literal["hand", "recorded"] = "hand"
    """Axes of forces: of the sensor, which moves with the hand, or of the poses."""
    force_sensor: _Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    """Pose of the force sensor in the frame of the recorded hand, x,y,z,qw,qx,qy,qz
    [m]. Moments are about its origin."""
    force_rest: _Seconds = 0.0
    """Time at the start without contact of the hand [s]; the mean force in this time,
    less the tool's weight, is the bias that is removed. 0 removes no bias."""
    tool_weight: Annotated[float, tyro.conf.arg(metavar="N")] = 0.0
    """Weight of the tool on the sensor, which is subtracted [N]."""
    tool_centre: _Vector = (0.0, 0.0, 0.0)
    """Centre of mass of the tool in the frame of the sensor [m]."""
    gravity: _Vector = (0.0, 0.0, -1.0)
    """Direction of gravity in the frame of the recorded poses."""
    frame: Annotated[str | PoseNumbers, of_text("FRAME", numbers(POSE))] = "first-pose"
    """Frame of the resulting poses: first-pose (of each motion), recorded, hinge (of a
    door, estimated from the motion), or a pose x,y,z,qw,qx,qy,qz [m]."""
    offset: Annotated[PoseNumbers | None, of_text("POSE", numbers(POSE))] = None
    """Pose of the object in the frame of the recorded hand, x,y,z,qw,qx,qy,qz [m]."""
    segment: Annotated[Segments, of_text("HOW", _segments)] = "none"
    """Repetitions in a recording: none, rests (the motions between them, without
    motions back), or times since the first sample such as 1.5-4.2,6-9.5 [s]."""
    keep_rests: tyro.conf.FlagCreatePairsOff[bool] = False
    """Keep rests at both ends."""
    cutoff: _Hertz = 10.0
    """Cut-off of the low-pass filter [Hz]; 0 disables the filter."""
    rate: _Hertz = 100.0
    """Samples per second of the result; 0 keeps the recorded samples."""
    largest_gap: _Seconds = 0.5
    """Longest gap between samples that is interpolated [s]."""

    def __post_init__(self) -> None:
        from gplfd_env.validation.fields import Range, check_choice, checked_number

        for name, (symbol, low) in _NUMBERS.items():
            if (number := getattr(self, name)) is not None:
                bounds = Range(low=low, high=1e5, unit=symbol)
                number = checked_number(f"ImportSettings.{name}", number, bounds)
                object.__setattr__(self, name, number)
        angles_of(self.angles)
        for name, allowed in _CHOICES.items():
            check_choice(name, getattr(self, name), allowed)
        for name in ("force_sensor", "offset", "frame"):
            pose = getattr(self, name)
            if pose is None or (name == "frame" and pose in _FRAMES):
                continue
            norm = 0.0 if isinstance(pose, str) else math.hypot(*pose[3:])
            valid = len(pose) == 7 and abs(norm - 1.0) < _NORM_TOLERANCE
            if not valid or not math.isfinite(sum(pose)):
                others = f"one of {', '.join(_FRAMES)}, or " * (name == "frame")
                raise ValueError(
                    f"{name} = {pose!r} must be {others}a pose x,y,z [m] and a unit "
                    "quaternion qw,qx,qy,qz"
                )
            unit = (*pose[:3], *(part / norm for part in pose[3:]))
            object.__setattr__(self, name, unit)
        for name in ("tool_centre", "gravity"):
            vector = getattr(self, name)
            three = not isinstance(vector, str) and len(vector) == 3
            if not three or not math.isfinite(sum(vector)):
                raise ValueError(f"{name} = {vector} must be three numbers x,y,z")
        if not any(self.gravity):
            raise ValueError("gravity = 0,0,0 has no direction; 0,0,-1 is downwards")
        if self.force_axes == "recorded" and any(self.force_sensor[4:]):
            raise ValueError(
                "the sensor is turned in the hand, and its forces are in the axes of "
                "the recorded poses; give its position alone, x,y,z,1,0,0,0"
            )
        times = () if self.segment in ("none", "rests") else self.segment
        if isinstance(times, str) or not all(start < end for start, end in times):
            raise ValueError(
                f"segment = {times!r} must be none, rests, or times such as "
                "1.5-4.2,6-9.5 [s], each start before its end"
            )
