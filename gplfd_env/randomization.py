"""Ranges from which every episode draws its door and circumstances.

All draws come from the environment's own generator, one uniform number per parameter
whether it is varied or not: two randomisations that differ in one range draw the same
values for all others.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from gplfd_env.config import DoorConfig, nearest_name
from gplfd_env.variation import LONGEST_DELAY, Placement, SensorNoise, Variation

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorRandomization:
    """What is drawn at every reset, and from where.

    A pair ``(low, high)`` is a uniform range that replaces the door's own value; None
    leaves it. Values on which the robot has no say (base and grasp) are drawn within
    plus or minus the number given.

    Raises:
        ValueError: A range is reversed, not finite, or beyond what the door, the
            placement or the sensors allow.
    """

    radius: Range | None = None
    """Handle-to-hinge distance [m]."""

    hinge_friction: Range | None = None
    """Coulomb friction of the hinge [N m]."""

    hinge_damping: Range | None = None
    """Viscous friction of the hinge [N m s/rad]."""

    closer_stiffness: Range | None = None
    """Closing torque that grows with the angle [N m/rad]."""

    closer_preload: Range | None = None
    """Constant closing torque [N m]."""

    panel_mass: Range | None = None
    """Mass of the leaf [kg]."""

    handle_height: Range | None = None
    """Height of the handle above the floor [m]."""

    base_position: float = 0.0
    """Placement error of the base in x and y, each within ± this [m]."""

    base_yaw: float = 0.0
    """Heading error of the base within ± this [rad]."""

    grasp_height: float = 0.0
    """Grasped point along the bar within ± this [m]."""

    grasp_depth: float = 0.0
    """Bar between the finger pads within ± this [m]."""

    pose_noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of the observed position [m] and rotation vector [rad]."""

    wrench_noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of the observed force [N] and torque [N m]."""

    longest_delay: int = 0
    """Commands take effect after 0 to this many control periods."""

    def __post_init__(self) -> None:
        for name in (*_DOOR_FIELDS, *_NOISES):
            value = getattr(self, name)
            if value is not None or name in _NOISES:
                object.__setattr__(self, name, _pair(name, value))
        for name in _DOOR_FIELDS:
            _check_order(name, getattr(self, name))
        for name in _SYMMETRIC:
            object.__setattr__(self, name, _half_width(name, getattr(self, name)))
        _check_delay(self.longest_delay)
        # Both ends of every range make a valid episode, so all between do.
        for end in (0.0, 1.0):
            try:
                self._variation(DoorConfig(), np.full(_DRAWS, end))
            except ValueError as error:
                raise ValueError(
                    f"this DoorRandomization would draw impossible episodes: {error}"
                ) from None

    @property
    def idle(self) -> bool:
        """Whether nothing is varied."""
        return self == DoorRandomization()

    def sample(self, door: DoorConfig, rng: np.random.Generator) -> Variation:
        """Draw one episode.

        Args:
            door: Gives every value that is not varied.
            rng: Where the draws come from; always the same number of them.
        """
        return self._variation(door, rng.random(_DRAWS))

    def _variation(self, door: DoorConfig, draws: np.ndarray[Any, Any]) -> Variation:
        unit = iter(draws.tolist())
        fields = {}
        for name in _DOOR_FIELDS:
            share, bounds = next(unit), getattr(self, name)
            if bounds is not None:
                fields[name] = bounds[0] + share * (bounds[1] - bounds[0])
        widths = (
            *(self.base_position, self.base_position, self.base_yaw),
            *(self.grasp_height, self.grasp_depth),
        )
        x, y, yaw, height, depth = ((2.0 * next(unit) - 1.0) * w for w in widths)
        delay = min(int(next(unit) * (self.longest_delay + 1)), self.longest_delay)
        return Variation(
            door=dataclasses.replace(door, **fields),
            placement=Placement(
                base_x=x,
                base_y=y,
                base_yaw=yaw,
                grasp_height=height,
                grasp_depth=depth,
            ),
            noise=SensorNoise(
                position=self.pose_noise[0],
                rotation=self.pose_noise[1],
                force=self.wrench_noise[0],
                torque=self.wrench_noise[1],
            ),
            delay=delay,
        )


_DOOR_FIELDS: Final = (
    *("radius", "hinge_friction", "hinge_damping", "closer_stiffness"),
    *("closer_preload", "panel_mass", "handle_height"),
)
_SYMMETRIC: Final = ("base_position", "base_yaw", "grasp_height", "grasp_depth")
_NOISES: Final = ("pose_noise", "wrench_noise")
_DRAWS: Final = len(_DOOR_FIELDS) + 6

RandomizationSpec = str | Mapping[str, Any] | DoorRandomization
"""What `door_randomization` accepts."""


def door_randomization(spec: RandomizationSpec) -> DoorRandomization:
    """Resolve a randomisation's name, mapping or record.

    Args:
        spec: A preset's name (``"mild"``), a mapping of `DoorRandomization` fields with
            an optional ``"preset"`` to start from, or a `DoorRandomization`.

    Raises:
        ValueError: An unknown preset or field, or an impossible range.
        TypeError: Anything else.
    """
    if isinstance(spec, DoorRandomization):
        return spec
    if isinstance(spec, str):
        return _preset(spec)
    if not isinstance(spec, Mapping):
        raise TypeError(
            "randomization must be a preset's name, a mapping of DoorRandomization "
            f"fields or a DoorRandomization, got {spec!r} ({type(spec).__name__})"
        )
    fields = dict(spec)
    start = _preset(fields.pop("preset", "none"))
    known = [field.name for field in dataclasses.fields(DoorRandomization)]
    for name in fields:
        if name not in known:
            raise ValueError(
                f"unknown randomization field {name!r}{nearest_name(name, known)}; "
                f"fields: {', '.join(known)}, preset"
            )
    return dataclasses.replace(start, **fields)


def _preset(name: object) -> DoorRandomization:
    if isinstance(name, str) and name in RANDOMIZATIONS:
        return RANDOMIZATIONS[name]
    raise ValueError(
        f"unknown randomization {name!r}{nearest_name(name, RANDOMIZATIONS)}; "
        f"presets: {', '.join(RANDOMIZATIONS)}; or give a mapping of "
        "DoorRandomization fields"
    )


def _pair(name: str, value: Any) -> tuple[float, float]:
    # A text of two digits would pass for a pair.
    pair: Any = () if isinstance(value, str) else value
    try:
        low, high = map(float, pair)
    except (TypeError, ValueError):
        raise ValueError(
            f"DoorRandomization.{name} = {value!r} must be a pair of numbers"
        ) from None
    return low, high


def _check_order(name: str, bounds: Range | None) -> None:
    if bounds is not None and not bounds[0] <= bounds[1]:
        raise ValueError(
            f"DoorRandomization.{name} = {bounds} must be (low, high) with low <= high"
        )


def _half_width(name: str, value: object) -> float:
    number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not number or not 0.0 <= float(value) < math.inf:  # type: ignore[arg-type]
        raise ValueError(
            f"DoorRandomization.{name} = {value!r} must be a number >= 0: values are "
            "drawn within plus or minus it"
        )
    return float(value)  # type: ignore[arg-type]


def _check_delay(value: object) -> None:
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or not 0 <= value <= LONGEST_DELAY:  # type: ignore[operator]
        raise ValueError(
            f"DoorRandomization.longest_delay = {value!r} must be a whole number of "
            f"control periods from 0 to {LONGEST_DELAY}"
        )


RANDOMIZATIONS: Final[Mapping[str, DoorRandomization]] = MappingProxyType(
    {
        "none": DoorRandomization(),
        "mild": DoorRandomization(
            hinge_friction=(0.2, 1.0),
            hinge_damping=(0.2, 1.0),
            panel_mass=(8.0, 16.0),
            handle_height=(0.80, 0.85),
            base_position=0.01,
            base_yaw=math.radians(1.0),
            grasp_height=0.02,
            grasp_depth=0.002,
            pose_noise=(0.0005, 0.002),
            wrench_noise=(0.3, 0.02),
            longest_delay=1,
        ),
        "hard": DoorRandomization(
            radius=(0.30, 0.60),
            hinge_friction=(0.0, 2.0),
            hinge_damping=(0.0, 2.0),
            closer_stiffness=(0.0, 1.0),
            closer_preload=(0.0, 3.0),
            panel_mass=(5.0, 30.0),
            handle_height=(0.70, 0.85),
            base_position=0.02,
            base_yaw=math.radians(3.0),
            grasp_height=0.04,
            grasp_depth=0.004,
            pose_noise=(0.001, 0.005),
            wrench_noise=(1.0, 0.05),
            longest_delay=3,
        ),
    }
)
"""Mild is what a careful laboratory leaves over; hard is a new door every time."""
