"""Doors of DoorBench (github.com/adamraudonis/DoorBench, MIT) as `DoorConfig`.

A door there is a ``spec.json`` of schema 1.0. Single swing doors with a lever, a knob
or a fixed pull are read. What a `DoorConfig` cannot represent is listed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gplfd_env.doors.config import DoorConfig
from gplfd_env.validation.fields import allowed_range
from gplfd_experiments.files.plain_data import entry, read_json

SCHEMA: Final = "1.0"

_BACKSET: Final = 0.06  # Of a handle for which none is given, as without a latch [m].
_BEYOND_GRIP: Final = 0.03  # A lever ends so far beyond the point where it is held [m].

Table = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True)
class ImportedDoor:
    """A door of another collection."""

    name: str
    """Its name there."""

    door: DoorConfig
    """What was read of it."""

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
    try:
        version = entry(spec, "schema_version", str)
        if version != SCHEMA:
            raise ValueError(f"its schema_version is {version!r}, not {SCHEMA!r}")
        family = entry(spec, "family", str)
        if family != "swing_single":
            raise ValueError(f"its family is {family!r}, not 'swing_single'")
        lost: list[str] = []
        fields = _leaf(spec, lost) | _closer(spec, lost) | _handle(spec, lost)
        if entry(_table(spec, "lock"), "engaged", bool):
            lost.append("its lock is engaged; the door is left unlocked")
        name = entry(spec, "id", str)
        door = DoorConfig(**_within(fields, lost))
    except ValueError as error:
        raise ValueError(f"{path} is no door that can be imported: {error}") from error
    return ImportedDoor(name=name, door=door, lost=tuple(lost))


def _table(spec: Table, *names: str) -> Table:
    for name in names:
        spec = entry(spec, name, dict[str, Any])
    return spec


def _leaf(spec: Table, lost: list[str]) -> dict[str, Any]:
    """Return the fields of the leaf, its hinge, and the handle's place on it."""
    leaf, hinge = _table(spec, "leaf"), _table(spec, "hinge")
    width = entry(leaf, "width", float)
    latch = _table(spec, "physics", "latch")
    backset = entry(latch, "backset_m", float) or _BACKSET
    tilt = entry(hinge, "axis_tilt_deg", float)
    if tilt:
        lost.append(f"its hinge axis is tilted by {tilt:g}°; here it is upright")
    side = entry(hinge, "side", str)
    if side not in ("left", "right"):
        raise ValueError(f"its hinge is at the {side!r}, neither left nor right")
    physics = _table(spec, "physics", "hinge")
    pushed = entry(_table(spec, "robot"), "is_push", bool)
    widest = entry(_table(spec, "kinematics"), "max_open_deg", float)
    return {
        "radius": width - backset,
        "leaf_width": width,
        "backset": backset,
        "leaf_thickness": entry(leaf, "thickness", float),
        "panel_mass": entry(_table(spec, "physics", "mass"), "total_kg", float),
        "handle_height": entry(_table(spec, "operator"), "height", float),
        "swing": "push" if pushed else "pull",
        "hinge_side": side,
        "hinge_friction": entry(physics, "coulomb_torque_Nm", float),
        "hinge_damping": entry(physics, "air_damping_Nms_per_rad", float),
        "stiction": entry(physics, "stick_torque_Nm", float),
        "stop_angle": math.radians(widest),
    }


def _closer(spec: Table, lost: list[str]) -> dict[str, Any]:
    closer = _table(spec, "physics", "closer")
    hold, boost = closer.get("hold_open_rad"), entry(closer, "latch_boost", float)
    if hold is not None:
        lost.append(f"its closer holds the door open at {hold!r:.20} rad")
    if boost != 1.0:
        lost.append(f"its closer's latch boost of {boost:g}")
    opening = entry(closer, "damping_opening", float)
    fields = {
        "closer_preload": entry(closer, "spring_preload_Nm", float),
        "closer_stiffness": entry(closer, "spring_stiffness_Nm_per_rad", float),
        "closer_damping": opening,
        "closing_damping": entry(closer, "damping_closing", float) - opening,
        "backcheck_damping": entry(closer, "backcheck_damping", float),
    }
    angle = entry(closer, "backcheck_angle_rad", float | None)
    return fields if angle is None else {**fields, "backcheck_angle": angle}


def _handle(spec: Table, lost: list[str]) -> dict[str, Any]:
    """Return the fields of handle and latch."""
    latch = _table(spec, "physics", "latch")
    model = entry(_table(spec, "operator"), "model", str)
    kind = model.partition("_")[0]
    if kind not in ("lever", "knob"):
        if entry(latch, "operator_travel", float) > 0.0:
            raise ValueError(f"its handle is {model!r}, neither lever, knob nor fixed")
        if entry(latch, "throw_m", float) > 0.0:
            lost.append("its latch, which its fixed handle does not draw")
        return {"handle": "bar"}
    fields: dict[str, Any] = {
        "handle": kind,
        "handle_preload": entry(latch, "operator_spring_preload", float),
        "handle_stiffness": entry(latch, "operator_spring_rate", float),
        "handle_travel": entry(latch, "operator_travel", float),
        "dead_travel": entry(latch, "operator_dead_travel", float),
    }
    if kind == "lever":
        grip = entry(latch, "operator_grip_offset_m", float)
        fields["handle_length"] = grip + _BEYOND_GRIP
    if entry(latch, "throw_m", float) > 0.0:
        fields |= {
            "latch": "spring",
            "bolt_throw": entry(latch, "throw_m", float),
            "bolt_preload": entry(latch, "bolt_spring_preload_N", float),
            "bolt_stiffness": entry(latch, "bolt_spring_rate_N_per_m", float),
        }
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
