"""Doors of DoorBench (github.com/adamraudonis/DoorBench, MIT) as `DoorConfig`.

Reads hinged, sliding and folding doors of schema 1.0 with a handle that a gripper can
operate from the robot's side: levers, knobs, fixed pulls, paddles, exit devices, thumb
latches.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.doors.config import DoorConfig, Handle
from gplfd_env.doors.hardware import CLEAR_WAY, sliding_gain
from gplfd_env.validation.fields import Range, allowed_range
from gplfd_experiments.files.plain_data import entry, read_json

SCHEMA: Final = "1.0"

_BACKSET: Final = 0.06  # Of a handle for which none is given, as without a latch [m].
_BEYOND_GRIP: Final = 0.03  # A lever ends so far beyond the point where it is held [m].
_BESIDE_EDGE: Final = 0.15
"""A touch bar is held where its lock case ends, at this distance from the edge [m]."""
_REACHED: Final = 1.0
"""Radius at which the robot opens doors of both swings and sides [m]."""
_TOUCH_BAR_ARM: Final = 0.05  # Turns a touch bar's straight travel into an angle [m].
_LEAF: Final = {
    "leaf.width": "leaf/width",
    "leaf.thickness": "leaf/thickness",
    "panel_mass": "physics/mass/total_kg",
    "handle_height": "operator/height",
}
_HINGED: Final = {
    "hinge_friction": "physics/hinge/coulomb_torque_Nm",
    "hinge_damping": "physics/hinge/air_damping_Nms_per_rad",
    "stiction": "physics/hinge/stick_torque_Nm",
    "closer.preload": "physics/closer/spring_preload_Nm",
    "closer.stiffness": "physics/closer/spring_stiffness_Nm_per_rad",
    "closer.damping": "physics/closer/damping_opening",
    "closer.backcheck_damping": "physics/closer/backcheck_damping",
}
_HANDLE: Final = {
    "lockset.handle_preload": "physics/latch/operator_spring_preload",
    "lockset.handle_stiffness": "physics/latch/operator_spring_rate",
    "lockset.handle_travel": "physics/latch/operator_travel",
    "lockset.dead_travel": "physics/latch/operator_dead_travel",
}
_KINDS: Final[Mapping[str, Handle]] = {
    "lever": "lever",
    "knob": "knob",
    "paddle": "paddle",
    "handleset": "handleset",
    "thumb": "handleset",
    "panic": "touch-bar",
    "pull": "bar",
    "push": "bar",
    "barn": "bar",
    "bifold": "bar",
    "hook": "bar",
    "shoji": "bar",
    "none": "bar",
    "cold": "paddle",
}
"""Handles by the first word of an operator's model."""
_NO_BARS: Final = ("pull_ring", "pull_flush_recessed", "pull_finger_cup")
"""Pulls that a gripper does not hold like a bar."""
_LATCH: Final = {
    "lockset.bolt_throw": "physics/latch/throw_m",
    "lockset.bolt_preload": "physics/latch/bolt_spring_preload_N",
    "lockset.bolt_stiffness": "physics/latch/bolt_spring_rate_N_per_m",
}
"""Fields of `DoorConfig` and its parts, and their places in a specification."""


class ImportedDoor(NamedTuple):
    """A door of another collection, with its name there."""

    name: str
    door: DoorConfig
    lost: tuple[str, ...]
    """Properties that cannot be represented, a line each."""


def read_doorbench(path: str | Path) -> ImportedDoor:
    """Read a ``spec.json``.

    Raises:
        ValueError: It is not of the schema, or its family, handle or radius is none
            that a `DoorConfig` has.
        OSError: The file cannot be read.
    """
    spec = read_json(path)
    lost: list[str] = []
    try:
        fields = _fields(spec, lost)
        name = _at(spec, "id", str)
        door = DoorConfig(**_nested(_within(fields, lost)))
    except ValueError as error:
        raise ValueError(f"{path} cannot be imported as a door: {error}") from error
    return ImportedDoor(name, door, tuple(lost))


def _at(spec: Mapping[str, Any], place: str, kind: Any = float) -> Any:
    """Return the entry at a path of names, as the required type."""
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
    if family not in _FAMILIES:
        reason = _OTHERS.get(family.partition("_")[0], "an unknown one")
        known = ", ".join(_FAMILIES)
        raise ValueError(f"its family is {family!r} ({reason}), none of {known}")
    fields: dict[str, Any] = {name: _at(spec, place) for name, place in _LEAF.items()}
    fields["hinge_side"] = side = _at(spec, "hinge/side", str)
    if side not in ("left", "right"):
        raise ValueError(f"its hinge is at the {side!r}, neither left nor right")
    fields |= _FAMILIES[family](spec, lost)
    fields |= _operated(spec, fields, lost)
    fields["radius"] = fields["leaf.width"] - fields["leaf.backset"]
    if held := _at(spec, "physics/latch/holding_force_N"):
        lost.append(f"the {held:g} N with which its latch holds it")
    if _at(spec, "lock/engaged", bool):
        lost.append("its lock is engaged; the door is left unlocked")
    return fields


def _hinged(spec: Mapping[str, Any], lost: list[str]) -> dict[str, Any]:
    """Return the fields of hinge and closer."""
    fields: dict[str, Any] = {name: _at(spec, place) for name, place in _HINGED.items()}
    motion = _at(spec, "kinematics", dict[str, Any])
    if motion.get("joining_bolt_engaged") is False:
        raise ValueError("its halves are not joined: two leaves, one above the other")
    if _at(spec, "leaf/count") > 1:
        lost.append("its other leaf")
    if motion.get("both_ways"):
        lost.append("it also opens the other way")
    if rest := entry({"rest_angle_deg": 0.0} | motion, "rest_angle_deg", float):
        lost.append(f"it rests open at {rest:g}°; here it is closed")
    hinge = _at(spec, "hinge", dict[str, Any])
    if beyond := entry({"pivot_offset_m": 0.0} | hinge, "pivot_offset_m", float):
        lost.append(f"the {beyond:g} m of its leaf beyond the pivot")
        fields["leaf.width"] = _at(spec, "leaf/width") - beyond
    fields["swing"] = "push" if _at(spec, "robot/is_push", bool) else "pull"
    fields["stop_angle"] = math.radians(_at(spec, "kinematics/max_open_deg"))
    if tilt := _at(spec, "hinge/axis_tilt_deg"):
        lost.append(f"its hinge axis is tilted by {tilt:g}°; here it is upright")
    closing = _at(spec, "physics/closer/damping_closing")
    fields["closer.closing_damping"] = closing - fields["closer.damping"]
    angle = _at(spec, "physics/closer/backcheck_angle_rad", float | None)
    if angle is not None:
        fields["closer.backcheck_angle"] = angle
    hold = _at(spec, "physics/closer", dict[str, Any]).get("hold_open_rad")
    if hold is not None:
        lost.append(f"its closer holds the door open at {hold!r:.20} rad")
    if (boost := _at(spec, "physics/closer/latch_boost")) != 1.0:
        lost.append(f"its closer's latch boost of {boost:g}")
    return fields


def _rolling(spec: Mapping[str, Any], way: float, lost: list[str]) -> dict[str, Any]:
    """Return the fields of rollers with a travel [m] of the fully open door."""
    if "soft_close_damper" in _at(spec, "extras", tuple[str, ...]):
        lost.append("its soft-close damper, for which no force is given")
    if (closer := _at(spec, "closer/model", str)) != "none":
        lost.append(f"its closer {closer!r}")
    gain = sliding_gain(way)
    friction = _at(spec, "physics/roller/coulomb_force_N")
    damping = _at(spec, "physics/roller/viscous_damping_N_s_per_m")
    fields = {"hinge_friction": gain * friction, "hinge_damping": gain**2 * damping}
    return fields | {"swing": "pull"}


def _sliding(spec: Mapping[str, Any], lost: list[str]) -> dict[str, Any]:
    """Return the fields of a sliding leaf."""
    way = _at(spec, "kinematics/travel_m")
    if _at(spec, "leaf/count") > 1:
        lost.append("its other leaves, behind which it slides")
    # The force is that of the rollers also if the travel is limited to its range.
    within = min(way, _range_of("mechanism.clear_width").high)
    return {
        "motion": "sliding",
        "mechanism.clear_width": way,
        **_rolling(spec, within, lost),
    }


def _folding(spec: Mapping[str, Any], lost: list[str]) -> dict[str, Any]:
    """Return the fields of the leaves that fold to one jamb.

    The guided edge, which has the handle, moves like that of two leaves of half the
    width, for any number of leaves.
    """
    panels, motion = _at(spec, "leaf/count"), _at(spec, "kinematics", dict[str, Any])
    stacks = 1 if panels == 2 or motion.get("accordion") else 2
    if stacks == 2:
        lost.append("its other leaves, which fold to the other jamb")
    if panels > 2 * stacks:
        lost.append(f"its {panels:g} leaves; here two of the same width together")
    lost.append("its rollers' damping grows from 0; here it has its mean throughout")
    width = panels / stacks * _at(spec, "leaf/width")
    fields = _rolling(spec, width, lost)
    turn = math.acos(1.0 - CLEAR_WAY) / SUCCESS_ANGLE  # Of the first leaf, per rad.
    fields["hinge_friction"] = turn * _at(spec, _HINGED["hinge_friction"])
    fields["mechanism.roller_friction"] = _at(spec, "physics/roller/coulomb_force_N")
    fields["hinge_damping"] += turn**2 * _at(spec, _HINGED["hinge_damping"])
    stiction = turn * _at(spec, _HINGED["stiction"])
    mass = _at(spec, _LEAF["panel_mass"]) / stacks
    fields |= {"leaf.width": width, "panel_mass": mass, "stiction": stiction}
    return fields | {"motion": "folding"}


_FAMILIES: Final[
    Mapping[str, Callable[[Mapping[str, Any], list[str]], dict[str, Any]]]
] = {
    **dict.fromkeys(("swing_single", "swing_double", "pivot", "dutch"), _hinged),
    **dict.fromkeys(("saloon", "stall", "cold_storage", "gate_swing"), _hinged),
    **dict.fromkeys(("sliding_single", "sliding_bypass", "gate_sliding"), _sliding),
    **dict.fromkeys(("bifold", "accordion"), _folding),
}
"""Functions that read the fields of the motion of each family."""

_OTHERS: Final = {
    **dict.fromkeys(("automatic", "elevator"), "a motor opens it"),
    **dict.fromkeys(("vault", "blast", "ship"), "several bolts or dogs hold it"),
    **dict.fromkeys(("garage", "rollup"), "it is lifted"),
    **dict.fromkeys(("revolving", "turnstile"), "a rotor"),
    "baby": "its latch is lifted",
    "hatch": "it is horizontal, in a floor or ceiling",
    "pet": "a flap without a handle",
    "strip": "hanging strips",
}
"""Why a family cannot be represented, by the first word of its name."""


def _operated(
    spec: Mapping[str, Any], fields: Mapping[str, Any], lost: list[str]
) -> dict[str, Any]:
    """Return the fields of handle and latch on the robot's side."""
    operator = _at(spec, "operator", dict[str, Any])
    model = _at(spec, "operator/model", str)
    latched = _at(spec, "physics/latch/throw_m") > 0.0
    width, backset = fields["leaf.width"], _at(spec, "physics/latch/backset_m")
    far = operator.get("sides") == "push_side" and fields["swing"] == "pull"
    if far:
        model = str(operator.get("far_side", "none"))
        if model == "none":
            raise ValueError("the pull side has no handle")
    handle = _KINDS.get(model.partition("_")[0])
    if model == "push_button_screen":
        raise ValueError(
            f"its handle is {model!r}: a button, which a gripper with two fingers "
            "cannot press while it holds the pull"
        )
    if handle is None:
        known = ", ".join(_KINDS)
        raise ValueError(f"its handle is {model!r}, none that begins with {known}")
    # Without a backset, the handle is where the robot can hold it.
    nearest = min(width - _REACHED, _range_of("leaf.backset").high)
    if fields.get("motion") == "folding":  # Its path depends on where it is.
        nearest = 0.0
    found: dict[str, Any] = {
        "handle": handle,
        "leaf.backset": backset or round(max(_BACKSET, nearest), 6),
    }
    if handle == "bar":
        travel = 0.0 if far else _at(spec, "physics/latch/operator_travel")
        if travel > 0.0 and model != "pull_ring":
            raise ValueError(f"its handle is {model!r}, a pull that turns or slides")
        if not model.startswith("pull") or model in _NO_BARS:
            lost.append(f"its handle {model!r}; here a fixed bar is held")
        if latched:
            lost.append("its latch, which its fixed handle does not release")
        return found
    if latched:
        found["latch"] = "spring"
        found |= {name: _at(spec, place) for name, place in _LATCH.items()}
    if far:
        lost.append(f"the spring of {model!r} on this side, whose value is not given")
        return found
    found |= {name: _at(spec, place) for name, place in _HANDLE.items()}
    grip = _at(spec, "physics/latch/operator_grip_offset_m")
    if handle == "lever":
        found["lockset.handle_length"] = grip + _BEYOND_GRIP
    elif handle == "touch-bar":
        found["leaf.backset"] = round(max(_BESIDE_EDGE, nearest), 6)
        if grip == 0.0:
            # A straight travel [m, N, N/m] as that of an arm.
            grip = _TOUCH_BAR_ARM
            found["lockset.handle_travel"] /= grip
            found["lockset.dead_travel"] /= grip
            found["lockset.handle_preload"] *= grip
            found["lockset.handle_stiffness"] *= grip**2
    if handle not in ("lever", "knob"):
        found["lockset.handle_arm"] = grip
    return found


def _within(fields: dict[str, Any], lost: list[str]) -> dict[str, Any]:
    """Return fields limited to their ranges; add the limited ones to `lost`.

    A radius out of range is not limited: it would be another door, and `DoorConfig`
    raises.
    """
    result = dict(fields)
    for name, value in fields.items():
        if isinstance(value, str) or name in ("radius", "leaf.width"):
            continue
        allowed = _range_of(name)
        nearest = min(max(value, allowed.low), allowed.high)
        if nearest != value:
            lost.append(f"{name} = {value:g} is outside {allowed}; {nearest:g} instead")
            result[name] = nearest
    if result["leaf.backset"] != fields["leaf.backset"]:
        result["leaf.width"] = None
    return result


def _range_of(name: str) -> Range:
    """Return the range of a field of a door or, as in ``closer.preload``, of a part."""
    part, _, field = name.rpartition(".")
    return allowed_range(
        type(getattr(DoorConfig(), part)) if part else DoorConfig, field
    )


def _nested(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `DoorConfig`, with a mapping for each part."""
    arguments: dict[str, Any] = {}
    for name, value in fields.items():
        part, _, field = name.rpartition(".")
        (arguments.setdefault(part, {}) if part else arguments)[field] = value
    return arguments
