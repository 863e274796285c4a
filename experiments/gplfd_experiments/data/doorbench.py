"""Doors of DoorBench, schema 1.0 (github.com/adamraudonis/DoorBench, MIT)."""

import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.doors.config import DoorConfig, Handle
from gplfd_env.doors.hardware import CLEAR_WAY, sliding_gain
from gplfd_env.validation.fields import Range, allowed_range
from gplfd_experiments.files.plain_data import entry, read_json

_BACKSET: Final = 0.06  # Of a handle for which none is given, as without a latch [m].
_BEYOND_GRIP: Final = 0.03  # A lever ends so far beyond the point where it is held [m].
_BESIDE_EDGE: Final = 0.15
"""A touch bar is held where its lock case ends, at this distance from the edge [m]."""
_REACHED: Final = 1.0
"""Radius at which the robot opens doors of both swings and sides [m]."""
_TOUCH_BAR_ARM: Final = 0.05  # Turns a touch bar's straight travel into an angle [m].
_PLACES: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
"""Fields of `DoorConfig` and its parts, and their places in a specification."""
_LOST: Final = {
    "physics/latch/holding_force_N": (0, "the {:g} N with which its latch holds it"),
    "lock/engaged": (False, "its lock is engaged; the door is left unlocked"),
}
_LOST_OF_HINGES: Final = {
    "leaf/count": (1, "its other leaf"),
    "kinematics/both_ways": (False, "it also opens the other way"),
    "kinematics/rest_angle_deg": (0, "it rests open at {:g}°; here it is closed"),
    "hinge/pivot_offset_m": (0, "the {:g} m of its leaf beyond the pivot"),
    "hinge/axis_tilt_deg": (0, "its hinge axis is tilted by {:g}°; here it is upright"),
    "physics/closer/hold_open_rad": (None, "its closer holds the door open at {} rad"),
    "physics/closer/latch_boost": (1, "its closer's latch boost of {:g}"),
}
"""Entries, the value that can be represented, and what is lost of another."""
_KINDS: Final[Mapping[str, Handle]] = {
    "lever": "lever",
    "knob": "knob",
    **dict.fromkeys(("paddle", "cold"), "paddle"),
    **dict.fromkeys(("handleset", "thumb"), "handleset"),
    "panic": "touch-bar",
    **dict.fromkeys(("pull", "push", "barn", "bifold", "hook", "shoji", "none"), "bar"),
}
"""Handles by the first word of an operator's model."""
_NO_BARS: Final = ("pull_ring", "pull_flush_recessed", "pull_finger_cup")
"""Pulls that a gripper does not hold like a bar."""

_Fields = dict[str, Any]


class ImportedDoor(NamedTuple):
    """A door of another collection, with its name there."""

    name: str
    door: DoorConfig
    lost: tuple[str, ...]  # Properties that cannot be represented, a line each.


class _Specification(NamedTuple):
    """Entries of a door, and what of them cannot be represented."""

    entries: Mapping[str, Any]
    lost: list[str]

    def at(self, place: str, kind: Any = float, default: Any = ...) -> Any:
        """Return the entry at a path of names, as the required type."""
        *tables, name = place.split("/")
        spec = self.entries
        for table in tables:
            spec = entry(spec, table, dict[str, Any])
        absent = default is not ... and name not in spec
        return default if absent else entry(spec, name, kind)

    def all_at(self, places: Mapping[str, str]) -> _Fields:
        """Return fields from their places."""
        return {name: self.at(place) for name, place in places.items()}

    def lose(self, value: Any, text: str) -> None:
        """Note a property that cannot be represented, if its value is not empty."""
        if value:
            self.lost.append(text)

    def lose_all(self, entries: Mapping[str, tuple[Any, str]]) -> None:
        """Note the entries that are other than those that can be represented."""
        for place, (represented, text) in entries.items():
            value = self.at(place, Any, represented)
            self.lose(value != represented, text.format(value))


def read_doorbench(path: str | Path) -> ImportedDoor:
    """Read a ``spec.json``; raise ValueError for one that a `DoorConfig` cannot be."""
    spec = _Specification(read_json(path), [])
    try:
        version, family = spec.at("schema_version", str), spec.at("family", str)
        if version != "1.0":
            raise ValueError(f"its schema_version is {version!r}, not '1.0'")
        if family not in _FAMILIES:
            raise ValueError(f"its family is {family!r}, not {', '.join(_FAMILIES)}")
        fields = spec.all_at(_PLACES["leaf"])
        fields["hinge_side"] = side = spec.at("hinge/side", str)
        if side not in ("left", "right"):
            raise ValueError(f"its hinge is at the {side!r}, neither left nor right")
        fields |= _FAMILIES[family](spec)
        fields |= _operated(spec, fields)
        fields["radius"] = fields["leaf.width"] - fields["leaf.backset"]
        spec.lose_all(_LOST)
        limited = dict(fields)
        for name, value in fields.items():
            # A door with another radius would be another door; `DoorConfig` raises.
            if not isinstance(value, str) and name not in ("radius", "leaf.width"):
                allowed = _range_of(name)
                limited[name] = nearest = min(max(value, allowed.low), allowed.high)
                change = f"{name} = {value:g} is outside {allowed}; {nearest:g} instead"
                spec.lose(nearest != value, change)
        if limited["leaf.backset"] != fields["leaf.backset"]:
            limited["leaf.width"] = None
        arguments: _Fields = {}
        for name, value in limited.items():
            part, _, field = name.rpartition(".")
            (arguments.setdefault(part, {}) if part else arguments)[field] = value
        door = DoorConfig(**arguments)
        return ImportedDoor(spec.at("id", str), door, tuple(spec.lost))
    except ValueError as error:
        raise ValueError(f"{path} cannot be imported as a door: {error}") from error


def _hinged(spec: _Specification) -> _Fields:
    """Return the fields of hinge and closer."""
    fields = spec.all_at(_PLACES["hinged"])
    if spec.at("kinematics/joining_bolt_engaged", Any, True) is False:
        raise ValueError("its halves are not joined: two leaves, one above the other")
    spec.lose_all(_LOST_OF_HINGES)
    beyond = spec.at("hinge/pivot_offset_m", default=0.0)
    closing = spec.at("physics/closer/damping_closing")
    fields["leaf.width"] = spec.at("leaf/width") - beyond
    fields["swing"] = "push" if spec.at("robot/is_push", bool) else "pull"
    fields["stop_angle"] = math.radians(spec.at("kinematics/max_open_deg"))
    fields["closer.closing_damping"] = closing - fields["closer.damping"]
    angle = spec.at("physics/closer/backcheck_angle_rad", float | None)
    if angle is not None:
        fields["closer.backcheck_angle"] = angle
    return fields


def _rolling(spec: _Specification, way: float) -> _Fields:
    """Return the fields of rollers with a travel [m] of the fully open door."""
    soft = "soft_close_damper" in spec.at("extras", tuple[str, ...])
    spec.lose(soft, "its soft-close damper, for which no force is given")
    closer = spec.at("closer/model", str)
    spec.lose(closer != "none", f"its closer {closer!r}")
    gain = sliding_gain(way)
    damping = gain**2 * spec.at("physics/roller/viscous_damping_N_s_per_m")
    friction = gain * spec.at("physics/roller/coulomb_force_N")
    return {"swing": "pull", "hinge_friction": friction, "hinge_damping": damping}


def _sliding(spec: _Specification) -> _Fields:
    """Return the fields of a sliding leaf."""
    way = spec.at("kinematics/travel_m")
    spec.lose(spec.at("leaf/count") > 1, "its other leaves, behind which it slides")
    # The force is that of the rollers also if the travel is limited to its range.
    within = min(way, _range_of("mechanism.clear_width").high)
    return {"motion": "sliding", "mechanism.clear_width": way} | _rolling(spec, within)


def _folding(spec: _Specification) -> _Fields:
    """Return the fields of two leaves that fold to one jamb, for any number of them."""
    panels, accordion = spec.at("leaf/count"), "kinematics/accordion"
    stacks = 1 if panels == 2 or spec.at(accordion, Any, False) else 2
    spec.lose(stacks == 2, "its other leaves, which fold to the other jamb")
    many = panels > 2 * stacks
    spec.lose(many, f"its {panels:g} leaves; here two of the same width together")
    spec.lost.append("its rollers' damping grows from 0; here it has its mean")
    width = panels / stacks * spec.at("leaf/width")
    fields = _rolling(spec, width)
    turn = math.acos(1.0 - CLEAR_WAY) / SUCCESS_ANGLE  # Of the first leaf, per rad.
    fields["hinge_damping"] += turn**2 * spec.at(_PLACES["hinged"]["hinge_damping"])
    return fields | {
        "motion": "folding",
        "leaf.width": width,
        "panel_mass": spec.at(_PLACES["leaf"]["panel_mass"]) / stacks,
        "hinge_friction": turn * spec.at(_PLACES["hinged"]["hinge_friction"]),
        "stiction": turn * spec.at(_PLACES["hinged"]["stiction"]),
        "mechanism.roller_friction": spec.at("physics/roller/coulomb_force_N"),
    }


_FAMILIES: Final[Mapping[str, Callable[[_Specification], _Fields]]] = {
    **dict.fromkeys(("swing_single", "swing_double", "pivot", "dutch"), _hinged),
    **dict.fromkeys(("saloon", "stall", "cold_storage", "gate_swing"), _hinged),
    **dict.fromkeys(("sliding_single", "sliding_bypass", "gate_sliding"), _sliding),
    **dict.fromkeys(("bifold", "accordion"), _folding),
}
"""Functions that read the fields of the motion of each family."""


def _operated(spec: _Specification, fields: Mapping[str, Any]) -> _Fields:
    """Return the fields of handle and latch on the robot's side."""
    model = spec.at("operator/model", str)
    latched = spec.at("physics/latch/throw_m") > 0.0
    width, backset = fields["leaf.width"], spec.at("physics/latch/backset_m")
    one_sided = spec.at("operator/sides", Any, "both") == "push_side"
    far = one_sided and fields["swing"] == "pull"
    if far and (model := str(spec.at("operator/far_side", Any, "none"))) == "none":
        raise ValueError("the pull side has no handle")
    handle = _KINDS.get(model.partition("_")[0])
    if handle is None or model == "push_button_screen":
        raise ValueError(
            f"its handle is {model!r}, which a gripper with two fingers cannot operate "
            f"or hold; it can hold those that begin with {', '.join(_KINDS)}"
        )
    # Without a backset, the handle is where the robot can hold it.
    nearest = min(width - _REACHED, _range_of("leaf.backset").high)
    if fields.get("motion") == "folding":  # Its path depends on where it is.
        nearest = 0.0
    backset = backset or round(max(_BACKSET, nearest), 6)
    operated: _Fields = {"handle": handle, "leaf.backset": backset}
    if handle == "bar":
        travel = 0.0 if far else spec.at("physics/latch/operator_travel")
        if travel > 0.0 and model != "pull_ring":
            raise ValueError(f"its handle is {model!r}, a pull that turns or slides")
        other = not model.startswith("pull") or model in _NO_BARS
        spec.lose(other, f"its handle {model!r}; here a fixed bar is held")
        spec.lose(latched, "its latch, which its fixed handle does not release")
        return operated
    if latched:
        operated |= {"latch": "spring"} | spec.all_at(_PLACES["latch"])
    if far:
        spec.lost.append(f"the spring of {model!r} on this side, which is not given")
        return operated
    operated |= spec.all_at(_PLACES["handle"])
    grip = spec.at("physics/latch/operator_grip_offset_m")
    if handle == "lever":
        operated["lockset.handle_length"] = grip + _BEYOND_GRIP
    elif handle == "touch-bar":
        operated["leaf.backset"] = round(max(_BESIDE_EDGE, nearest), 6)
        if grip == 0.0:
            # A straight travel [m, N, N/m] as that of an arm.
            grip = _TOUCH_BAR_ARM
            operated["lockset.handle_travel"] /= grip
            operated["lockset.dead_travel"] /= grip
            operated["lockset.handle_preload"] *= grip
            operated["lockset.handle_stiffness"] *= grip**2
    if handle not in ("lever", "knob"):
        operated["lockset.handle_arm"] = grip
    return operated


def _range_of(name: str) -> Range:
    """Return the range of a field of a door or, as in ``closer.preload``, of a part."""
    part, _, field = name.rpartition(".")
    record = type(getattr(DoorConfig(), part)) if part else DoorConfig
    return allowed_range(record, field)
