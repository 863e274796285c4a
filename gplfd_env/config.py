"""Which door: its geometry, its hinge, and the presets by name."""

import dataclasses
import difflib
import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, TypeVar

from gplfd_env.fields import allowed_range, check_quantities, quantity


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorConfig:
    """A hinged door with a vertical bar handle, hinge on the robot's right.

    The hinge axis lies in the bar's plane, so the handle moves on a circle of
    ``radius`` about it and its first motion is along the pulling direction.

    Raises:
        ValueError: A field is not finite or outside its range.
        TypeError: A field is not a number.
    """

    radius: float = quantity(
        0.50, unit="m", low=0.30, high=0.95, reason="the radii the robot can open"
    )
    """Distance from hinge axis to handle axis; beyond 0.65 m the base has to move."""

    hinge_friction: float = quantity(0.5, unit="N m", low=0.0, high=50.0)
    """Coulomb friction of the hinge."""

    hinge_damping: float = quantity(0.5, unit="N m s/rad", low=0.0, high=50.0)
    """Viscous friction of the hinge."""

    closer_stiffness: float = quantity(0.0, unit="N m/rad", low=0.0, high=50.0)
    """Door closer: closing torque that grows with the angle."""

    closer_preload: float = quantity(0.0, unit="N m", low=0.0, high=50.0)
    """Door closer: closing torque at every angle, also when closed."""

    panel_mass: float = quantity(12.0, unit="kg", low=1.0, high=100.0)
    """Mass of the door leaf."""

    handle_height: float = quantity(
        0.85, unit="m", low=0.50, high=1.22, reason="what torso and arm can serve"
    )
    """Height of the grasped point above the floor; beyond 0.90 m the base has to
    move."""

    handle_standoff: float = quantity(0.07, unit="m", low=0.06, high=0.12)
    """Distance between the bar's axis and the leaf's mid-plane."""

    def __post_init__(self) -> None:
        check_quantities(self)


_RADII: Final = allowed_range(DoorConfig, "radius")

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
    if isinstance(door, numbers.Real) and not isinstance(door, bool):
        return DoorConfig(radius=float(door))
    if isinstance(door, str | Mapping):
        hint = f"a radius in metres within {_RADII}"
        return preset(door, DOORS, "medium", "door", hint)
    raise TypeError(
        "door must be a preset's name, a radius in metres, a mapping of DoorConfig "
        f"fields or a DoorConfig, got {door!r} ({type(door).__name__})"
    )


Record = TypeVar("Record")


def preset(
    spec: str | Mapping[str, Any],
    presets: Mapping[str, Record],
    start: str,
    what: str,
    otherwise: str,
) -> Record:
    """Return the preset of a name, or one with other fields.

    Args:
        spec: A name, or a mapping of fields with an optional ``"preset"``.
        presets: Records by name.
        start: The preset that a mapping starts from if it names none.
        what: What messages call such a record.
        otherwise: What may be given in place of a name, for messages.

    Raises:
        ValueError: An unknown preset or field, or a value that the record refuses.
    """
    fields = {"preset": spec} if isinstance(spec, str) else dict(spec)
    name = fields.pop("preset", start)
    if not isinstance(name, str) or name not in presets:
        raise ValueError(
            f"unknown {what} {name!r}{nearest_name(name, presets)}; presets: "
            f"{', '.join(presets)}; or give {otherwise}"
        )
    return with_fields(presets[name], fields, what, other_keys=("preset",))


def with_fields(
    record: Record,
    fields: Mapping[str, Any],
    what: str,
    other_keys: Sequence[str] = (),
) -> Record:
    """Return a record with some fields changed.

    Args:
        record: A frozen dataclass.
        fields: New values by name.
        what: What messages call such a record.
        other_keys: What else a caller may write beside fields, for messages.

    Raises:
        ValueError: An unknown field, or a value that the record refuses.
    """
    given: Any = record
    known = [field.name for field in dataclasses.fields(given)]
    for field in fields:
        if field not in known:
            raise ValueError(
                f"unknown {what} field {field!r}{nearest_name(field, known)}; fields: "
                f"{', '.join([*known, *other_keys])}"
            )
    changed: Record = dataclasses.replace(given, **fields) if fields else record
    return changed


def nearest_name(name: object, known: Iterable[str]) -> str:
    """Return a hint at the known name that was probably meant; "" if none is near."""
    match = difflib.get_close_matches(str(name), list(known), n=1)
    return f" (did you mean {match[0]!r}?)" if match else ""
