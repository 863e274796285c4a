"""Doors of DoorBench (github.com/adamraudonis/DoorBench, MIT) as `DoorConfig`.

Read are single swing doors of schema 1.0 with a lever, a knob or a fixed pull.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from gplfd_env.doors.config import DoorConfig
from gplfd_env.validation.fields import allowed_range
from gplfd_experiments.files.plain_data import entry, read_json

SCHEMA: Final = "1.0"

_BACKSET: Final = 0.06  # Of a handle for which none is given, as without a latch [m].
_BEYOND_GRIP: Final = 0.03  # A lever ends so far beyond the point where it is held [m].
_LEAF: Final = {
    "leaf_width": "leaf/width",
    "leaf_thickness": "leaf/thickness",
    "panel_mass": "physics/mass/total_kg",
    "handle_height": "operator/height",
    "hinge_friction": "physics/hinge/coulomb_torque_Nm",
    "hinge_damping": "physics/hinge/air_damping_Nms_per_rad",
    "stiction": "physics/hinge/stick_torque_Nm",
    "closer_preload": "physics/closer/spring_preload_Nm",
    "closer_stiffness": "physics/closer/spring_stiffness_Nm_per_rad",
    "closer_damping": "physics/closer/damping_opening",
    "backcheck_damping": "physics/closer/backcheck_damping",
}
_HANDLE: Final = {
    "handle_preload": "physics/latch/operator_spring_preload",
    "handle_stiffness": "physics/latch/operator_spring_rate",
    "handle_travel": "physics/latch/operator_travel",
    "dead_travel": "physics/latch/operator_dead_travel",
}
_LATCH: Final = {
    "bolt_throw": "physics/latch/throw_m",
    "bolt_preload": "physics/latch/bolt_spring_preload_N",
    "bolt_stiffness": "physics/latch/bolt_spring_rate_N_per_m",
}
"""Fields of `DoorConfig`, and where a specification has their numbers."""


class ImportedDoor(NamedTuple):
    """A door of another collection, by its name there."""

    name: str
    door: DoorConfig
    lost: tuple[str, ...]
    """What could not be represented, a line each."""


def read_doorbench(path: str | Path) -> ImportedDoor:
    """Read a ``spec.json``.

    Raises:
        ValueError: It is not of the schema, not a single swing door, or its handle or
            radius is none that a `DoorConfig` has.
        OSError: The file cannot be read.
    """
    spec = read_json(path)
    lost: list[str] = []
    try:
        fields = _fields(spec, lost)
        name = _at(spec, "id", str)
        door = DoorConfig(**_within(fields, lost))
    except ValueError as error:
        raise ValueError(f"{path} is no door that can be imported: {error}") from error
    return ImportedDoor(name, door, tuple(lost))


def _at(spec: Mapping[str, Any], place: str, kind: Any = float) -> Any:
    """Return what stands at a path of names, as the type that it must have."""
    *tables, name = place.split("/")
    for table in tables:
        spec = entry(spec, table, dict[str, Any])
    return entry(spec, name, kind)


def _fields(spec: Mapping[str, Any], lost: list[str]) -> dict[str, Any]:
    """Return the fields of a door, and add to `lost` what it cannot represent."""
    version = _at(spec, "schema_version", str)
    if version != SCHEMA:
        raise ValueError(f"its schema_version is {version!r}, not {SCHEMA!r}")
    family = _at(spec, "family", str)
    if family != "swing_single":
        raise ValueError(f"its family is {family!r}, not 'swing_single'")
    fields: dict[str, Any] = {name: _at(spec, place) for name, place in _LEAF.items()}
    # The leaf and its hinge.
    fields["backset"] = _at(spec, "physics/latch/backset_m") or _BACKSET
    fields["radius"] = fields["leaf_width"] - fields["backset"]
    fields["hinge_side"] = side = _at(spec, "hinge/side", str)
    if side not in ("left", "right"):
        raise ValueError(f"its hinge is at the {side!r}, neither left nor right")
    fields["swing"] = "push" if _at(spec, "robot/is_push", bool) else "pull"
    fields["stop_angle"] = math.radians(_at(spec, "kinematics/max_open_deg"))
    if tilt := _at(spec, "hinge/axis_tilt_deg"):
        lost.append(f"its hinge axis is tilted by {tilt:g}°; here it is upright")
    # The closer.
    closing = _at(spec, "physics/closer/damping_closing")
    fields["closing_damping"] = closing - fields["closer_damping"]
    angle = _at(spec, "physics/closer/backcheck_angle_rad", float | None)
    if angle is not None:
        fields["backcheck_angle"] = angle
    hold = _at(spec, "physics/closer", dict[str, Any]).get("hold_open_rad")
    if hold is not None:
        lost.append(f"its closer holds the door open at {hold!r:.20} rad")
    if (boost := _at(spec, "physics/closer/latch_boost")) != 1.0:
        lost.append(f"its closer's latch boost of {boost:g}")
    # Handle and latch.
    model = _at(spec, "operator/model", str)
    latched = _at(spec, "physics/latch/throw_m") > 0.0
    kind = model.partition("_")[0]
    if kind in ("lever", "knob"):
        fields["handle"] = kind
        fields |= {name: _at(spec, place) for name, place in _HANDLE.items()}
        if kind == "lever":
            grip = _at(spec, "physics/latch/operator_grip_offset_m")
            fields["handle_length"] = grip + _BEYOND_GRIP
        if latched:
            fields["latch"] = "spring"
            fields |= {name: _at(spec, place) for name, place in _LATCH.items()}
    else:
        if _at(spec, "physics/latch/operator_travel") > 0.0:
            raise ValueError(f"its handle is {model!r}, neither lever, knob nor fixed")
        fields["handle"] = "bar"
        if latched:
            lost.append("its latch, which its fixed handle does not draw")
    if _at(spec, "lock/engaged", bool):
        lost.append("its lock is engaged; the door is left unlocked")
    return fields


def _within(fields: dict[str, Any], lost: list[str]) -> dict[str, Any]:
    """Return fields within their ranges, and add to `lost` which were not.

    A radius out of range is left to `DoorConfig` to refuse: it would be another door.
    """
    result = dict(fields)
    for name, value in fields.items():
        if isinstance(value, str) or name in ("radius", "leaf_width"):
            continue
        allowed = allowed_range(DoorConfig, name)
        nearest = min(max(value, allowed.low), allowed.high)
        if nearest != value:
            lost.append(f"{name} = {value:g} is outside {allowed}; {nearest:g} instead")
            result[name] = nearest
    if result["backset"] != fields["backset"]:
        result["leaf_width"] = None
    return result
