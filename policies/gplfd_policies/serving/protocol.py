"""Messages of the line protocol: one JSON object per line, strictly checked.

Numbers are written as the shortest decimal that is read as the same float64, so that
values are transferred bit for bit. docs/serving.md has the tables of all messages.
"""

import json
import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from gplfd_env.validation.fields import Range

VERSION: Final = 1
"""Version of the protocol; clients with another version are refused."""

MAX_LINE: Final = 65536
"""Longest line [bytes]."""

UNITS: Final = {
    "time": "s",
    "pose": "m and rad: x, y, z and rotation vector, task frame",
    "wrench": "N and N m: of the environment on the hand, task frame, at the hand",
    "stiffness": "N/m and N m/rad: along the columns of frame, about the task's axes",
    "damping": "N s/m and N m s/rad: on the same axes",
    "gripper_width": "m",
}

MOST_TURNED: Final = 7.0
"""Greatest component of a rotation vector, measured or commanded [rad]."""

_POSE: Final = (
    Range(low=-10, high=10, unit="m"),
    Range(low=-MOST_TURNED, high=MOST_TURNED, unit="rad"),
)
_WRENCH: Final = (Range(low=-1e4, high=1e4, unit="N"),) * 2
_SIZED: Final = {"ee_pose": (6, _POSE), "wrench": (6, _WRENCH)}
_MOST: Final = 64
_COUNT: Final = 2**53


class ProtocolError(ValueError):
    """A rejected message; the reply contains the reason."""

    def __init__(self, code: str, text: str, seq: int | None = None) -> None:
        super().__init__(text)
        self.reply = {"type": "error", "code": code, "seq": seq, "message": text}


class Observed(NamedTuple):
    """A checked observation, with `time` by the robot's clock [s]."""

    seq: int
    time: float
    values: dict[
        str, np.ndarray
    ]  # Also ``time`` (1,), ``ee_pose`` and ``wrench`` (6,).


def encode(message: Mapping[str, Any]) -> bytes:
    """Return a message as a line; raises a ValueError for NaN or infinity."""
    return json.dumps(message, allow_nan=False, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> dict[str, Any]:
    """Return the object of a line; raises `ProtocolError` if it has no type."""
    try:
        text = line.decode()  # json.loads would guess UTF-16 or UTF-32
        message = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ProtocolError("malformed", f"not a line of JSON: {error}") from None
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        text = 'a message is a JSON object with a text "type"'
        raise ProtocolError("malformed", text)
    return message


def observed(message: Mapping[str, Any]) -> Observed:
    """Check the fields of a ``reset`` or ``observe``; raises `ProtocolError`."""
    seq = message.get("seq")
    if type(seq) is not int or not 0 <= seq < _COUNT:
        raise ProtocolError("field", f"seq must be a whole number, got {seq!r:.40}")
    try:
        values = {
            name: _numbers(name, value)
            for name, value in message.items()
            if name not in ("type", "seq")
        }
        for name in ("time", *_SIZED):
            if name not in values:
                raise ProtocolError("field", f"{name} is missing")
        for name, (size, ranges) in _SIZED.items():
            if values[name].shape != (size,):
                got = values[name].size
                raise ProtocolError("field", f"{name} has {size} numbers, got {got}")
            given = values[name].tolist()
            for half, allowed in zip((given[:3], given[3:]), ranges, strict=True):
                if any(one not in allowed for one in half):
                    raise ProtocolError("range", f"{name} {half} is outside {allowed}")
        if values["time"].size != 1 or abs(time := float(values["time"][0])) > 1e10:
            raise ProtocolError("range", "time must be one number within ±1e10 s")
    except ProtocolError as error:
        error.reply["seq"] = seq
        raise
    return Observed(seq, time, values)


def _numbers(name: str, value: object) -> np.ndarray:
    """Return a number or a short list of numbers as an array of finite float64."""
    given = value if isinstance(value, list) else [value]
    if not 0 < len(given) <= _MOST or not {type(one) for one in given} <= {int, float}:
        text = f"{name:.40} must be a number or up to {_MOST} numbers"
        raise ProtocolError("field", text)
    try:
        array = np.array(given, dtype=np.float64)
    except OverflowError:
        array = np.full(1, np.inf)
    if not np.isfinite(array).all():
        raise ProtocolError("range", f"{name:.40} is not finite")
    return array


def numbers(array: Any) -> Any:
    """Return an array as nested lists, NaN as None and infinity as text."""
    values = np.asarray(array)
    if values.ndim:
        return [numbers(one) for one in values]
    value = values.item()
    if isinstance(value, bool) or math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)


def array(given: Any) -> np.ndarray:
    """Return the float64 array from the output of `numbers`."""
    if isinstance(given, list):
        return np.array([array(one) for one in given])
    return np.array(math.nan if given is None else float(given))


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a name stands twice in an object")
    return found


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a number of JSON")
