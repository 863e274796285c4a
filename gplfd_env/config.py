"""Which door: its geometry, its hinge, and the presets by name."""

from __future__ import annotations

import dataclasses
import difflib
import math
import numbers
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

RADIUS_RANGE: Final = (0.30, 0.65)
"""Handle-to-hinge distances [m] that the arm opens to the task's angle."""

HANDLE_HEIGHT_RANGE: Final = (0.50, 0.85)
"""Handle heights [m] that the torso's 0.35 m of lift can serve."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorConfig:
    """A hinged door with a vertical bar handle, hinge on the robot's right.

    The hinge axis lies in the bar's plane, so the handle moves on a circle of
    ``radius`` about it and its first motion is along the pulling direction.

    Raises:
        ValueError: A field is not finite or outside its range.
        TypeError: A field is not a number.
    """

    radius: float = 0.50
    """Distance from hinge axis to handle axis [m], 0.30 to 0.65."""

    hinge_friction: float = 0.5
    """Coulomb friction of the hinge [N m], 0 to 50."""

    hinge_damping: float = 0.5
    """Viscous friction of the hinge [N m s/rad], 0 to 50."""

    closer_stiffness: float = 0.0
    """Door closer: closing torque that grows with the angle [N m/rad], 0 to 50."""

    closer_preload: float = 0.0
    """Door closer: closing torque at every angle, also when closed [N m], 0 to 50."""

    panel_mass: float = 12.0
    """Mass of the door leaf [kg], 1 to 100."""

    handle_height: float = 0.85
    """Height of the grasped point above the floor [m], 0.50 to 0.85."""

    handle_standoff: float = 0.07
    """Distance between the bar's axis and the leaf's mid-plane [m], 0.06 to 0.12."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, numbers.Real):
                raise TypeError(
                    f"DoorConfig.{field.name} must be a number, got {value!r} "
                    f"({type(value).__name__})"
                )
            value = float(value)
            low, high = _RANGES[field.name]
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(
                    f"DoorConfig.{field.name} = {value!r} is outside "
                    f"[{low:g}, {high:g}] {_UNITS[field.name]}"
                )
            object.__setattr__(self, field.name, value)


_RANGES: Final[Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "radius": RADIUS_RANGE,
        "hinge_friction": (0.0, 50.0),
        "hinge_damping": (0.0, 50.0),
        "closer_stiffness": (0.0, 50.0),
        "closer_preload": (0.0, 50.0),
        "panel_mass": (1.0, 100.0),
        "handle_height": HANDLE_HEIGHT_RANGE,
        "handle_standoff": (0.06, 0.12),
    }
)
_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "radius": "m (the radii the arm can open)",
        "hinge_friction": "N m",
        "hinge_damping": "N m s/rad",
        "closer_stiffness": "N m/rad",
        "closer_preload": "N m",
        "panel_mass": "kg",
        "handle_height": "m (the heights the torso can serve)",
        "handle_standoff": "m",
    }
)

DOORS: Final[Mapping[str, DoorConfig]] = MappingProxyType(
    {
        "small": DoorConfig(radius=0.35),
        "medium": DoorConfig(radius=0.50),
        "large": DoorConfig(radius=0.65),
        "heavy": DoorConfig(radius=0.50, hinge_friction=2.0, closer_preload=5.0),
    }
)
"""Small, medium and large are demonstrated; heavy is a medium door that needs 14 N."""

DoorSpec = str | float | Mapping[str, Any] | DoorConfig
"""What `door_config` accepts."""


def door_config(door: DoorSpec) -> DoorConfig:
    """Resolve a door's name, radius, mapping or configuration.

    Args:
        door: A preset's name (``"medium"``), a radius [m] (``0.42``), a mapping of
            `DoorConfig` fields with an optional ``"preset"`` to start from
            (``{"preset": "medium", "hinge_friction": 2.0}``), or a `DoorConfig`.

    Raises:
        ValueError: An unknown preset or field, or a value outside its range.
        TypeError: Anything else.
    """
    if isinstance(door, DoorConfig):
        return door
    if isinstance(door, str):
        return _preset(door)
    if isinstance(door, Mapping):
        fields = dict(door)
        preset = fields.pop("preset", None)
        known = {field.name for field in dataclasses.fields(DoorConfig)}
        for name in fields:
            if name not in known:
                raise ValueError(
                    f"unknown door field {name!r}{nearest_name(name, known)}; "
                    f"fields: {', '.join(sorted(known))}, preset"
                )
        start = DoorConfig() if preset is None else _preset(preset)
        return dataclasses.replace(start, **fields)
    if isinstance(door, numbers.Real) and not isinstance(door, bool):
        return DoorConfig(radius=float(door))
    raise TypeError(
        "door must be a preset's name, a radius in metres, a mapping of DoorConfig "
        f"fields or a DoorConfig, got {door!r} ({type(door).__name__})"
    )


def _preset(name: object) -> DoorConfig:
    if isinstance(name, str) and name in DOORS:
        return DOORS[name]
    raise ValueError(
        f"unknown door {name!r}{nearest_name(name, DOORS)}; presets: "
        f"{', '.join(DOORS)}; or give a radius in metres within "
        f"[{RADIUS_RANGE[0]:g}, {RADIUS_RANGE[1]:g}]"
    )


def nearest_name(name: object, known: Iterable[str]) -> str:
    """Return a hint at the known name that was probably meant; "" if none is near."""
    match = difflib.get_close_matches(str(name), list(known), n=1)
    return f" (did you mean {match[0]!r}?)" if match else ""
