"""Messages of the line protocol, one JSON object per line: checks, transfer, journal.

Numbers are transferred bit for bit. docs/reference.md has the tables of all messages.
"""

import io
import itertools
import json
import math
import os
import select
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from gplfd_env.validation.fields import Range

Message = dict[str, Any]

VERSION: Final = 1  # Version of the protocol; clients with another version are refused.
MAX_LINE: Final = 65536  # Longest line [bytes].

UNITS: Final = {
    "time": "s",
    "pose": "m and rad: x, y, z and rotation vector, task frame",
    "wrench": "N and N m: of the environment on the hand, task frame, at the hand",
    "stiffness": "N/m and N m/rad: along the columns of frame, about the task's axes",
    "damping": "N s/m and N m s/rad: on the same axes",
    "gripper_width": "m",
}

MOST_TURNED: Final = 7.0
"""Greatest component of a rotation vector, unless the agent turns by more [rad]."""

BEGINNING: Final = b'{"journal":1'  # Beginning of the first line of every run.
LARGEST: Final = 2**30
"""Greatest size of a file [bytes]: at least an hour with all quantities explained."""

_FINITE: Final = Range(low=-1e300, high=1e300)
_RANGES: Final = {
    "time": (1, Range(low=-1e10, high=1e10, unit="s")),
    "ee_pose": (6, Range(low=-10, high=10, unit="m")),
    "wrench": (6, Range(low=-1e4, high=1e4, unit="N and N m")),
}
_LARGEST_COUNT: Final = 2**53
_MOST_UNSENT: Final = 2**20
_PIECE: Final = 4096  # what a writable pipe accepts at once


class ProtocolError(ValueError):
    """A rejected message; the reply contains the reason."""

    def __init__(self, code: str, text: str, seq: int | None = None) -> None:
        super().__init__(text)
        self.reply = {"type": "error", "code": code, "seq": seq, "message": text}


class Observed(NamedTuple):
    """A checked observation, with `time` by the robot's clock [s]."""

    seq: int
    time: float
    pose: np.ndarray  # (6,)
    wrench: np.ndarray  # (6,)
    values: dict[str, np.ndarray]  # for the agent, which may change them


def encode(message: Mapping[str, Any]) -> bytes:
    """Return a message as a line; raises a ValueError for NaN or infinity."""
    return json.dumps(message, allow_nan=False, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> Message:
    """Return the object of a line; raises `ProtocolError` if it has no type."""
    try:
        message = json.loads(line.decode())  # json.loads would guess UTF-16 or UTF-32
    except (ValueError, RecursionError) as error:
        raise ProtocolError("malformed", f"not a line of JSON: {error}") from None
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        text = 'a message is a JSON object with a text "type"'
        raise ProtocolError("malformed", text)
    return message


def observed(message: Mapping[str, Any], most_turned: float) -> Observed:
    """Check a ``reset`` or ``observe``, turned within ± a number [rad]."""
    seq = message.get("seq")
    if type(seq) is not int or not 0 <= seq < _LARGEST_COUNT:
        raise ProtocolError("field", f"seq must be a whole number, got {seq!r:.40}")
    values = {}
    for name in {**_RANGES, **message}:
        if name in ("type", "seq"):
            continue
        if name not in message:
            raise ProtocolError("field", f"{name} is missing", seq)
        value = message[name]
        entries = value if isinstance(value, list) else [value]
        size, allowed = _RANGES.get(name, (max(len(entries), 1), _FINITE))
        numeric = {type(entry) for entry in entries} <= {int, float}
        if not numeric or len(entries) != size:
            text = f"{name:.40} must be a number or a list of numbers"
            if name in _RANGES:
                text = f"{name} must be {size} numbers"
            raise ProtocolError("field", f"{text}, got {value!r:.80}", seq)
        limits = [allowed] * size
        if name == "ee_pose":
            limits[3:] = [Range(low=-most_turned, high=most_turned, unit="rad")] * 3
        for entry, limit in zip(entries, limits, strict=True):
            if not limit.low <= entry <= limit.high:
                text = f"{name:.40} {entries!r:.80} is outside {limit}"
                raise ProtocolError("range", text, seq)
        values[name] = np.array(entries, dtype=np.float64)
    pose, wrench = values["ee_pose"].copy(), values["wrench"].copy()
    return Observed(seq, float(values["time"][0]), pose, wrench, values)


def numbers(array: Any) -> Any:
    """Return an array as nested lists, NaN as None and infinity as text."""
    values = np.asarray(array)
    if values.ndim and not np.isfinite(values).all():
        return [numbers(part) for part in values]
    if values.ndim or np.isfinite(values):
        return values.tolist()
    return None if np.isnan(values) else str(values.item())


def array(entries: Any) -> np.ndarray:
    """Return the float64 array from the output of `numbers`."""
    if isinstance(entries, list):
        return np.array([array(entry) for entry in entries])
    return np.array(math.nan if entries is None else float(entries))


class Connection:
    """One end of a connection: a socket's descriptor, given twice, or two pipes'."""

    def __init__(self, reader: int, writer: int) -> None:
        self._reader, self._writer = reader, writer
        self._partial, self._unsent = b"", b""
        self.closed = False

    def lines(self, timeout: float = 0.0) -> list[bytes]:
        """Return complete lines that arrive in a time [s]; long ones set `closed`."""
        try:
            if not select.select([self._reader], [], [], timeout)[0]:
                return []
            data = os.read(self._reader, MAX_LINE)
        except OSError:
            data = b""
        lines = (self._partial + data).split(b"\n")
        accepted = list(itertools.takewhile(lambda line: len(line) <= MAX_LINE, lines))
        self.closed |= not data or len(accepted) < len(lines)
        self._partial = lines[-1]
        return accepted[: len(lines) - 1]

    def send(self, data: bytes = b"") -> None:
        """Send what does not block; a waiting megabyte, or no peer, sets `closed`."""
        self._unsent += data
        try:
            while self._unsent and select.select([], [self._writer], [], 0.0)[1]:
                sent = os.write(self._writer, self._unsent[:_PIECE])
                self._unsent = self._unsent[sent:]
        except OSError:
            self.closed = True
        self.closed |= len(self._unsent) > _MOST_UNSENT


class Journal:
    """Appends to a file that only the user can read; does nothing without a path."""

    def __init__(self, path: Path | None, about: Mapping[str, Any]) -> None:
        self._file: io.FileIO | None = None
        if path is not None:
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
            self._file = os.fdopen(file, "ab", buffering=0)
            # A kill may have truncated the last line of the last run.
            begun = b"\n" if self._file.tell() else b""
            self._file.write(begun + encode({"journal": 1, **about}))

    def write(
        self,
        at: float,
        received: bytes | str | None,
        replies: Sequence[Mapping[str, Any]],
        took: float,
    ) -> None:
        """Add a message with its replies, time and duration [s].

        `received` is a line of JSON, which is copied, other text, or None. If the file
        has its greatest size, or the disk is full, only the journal ends.
        """
        if self._file is None:
            return
        if not isinstance(received, bytes):
            received = json.dumps(received).encode()
        rest = encode({"at": at, "took": took, "out": list(replies)})
        try:
            if self._file.tell() > LARGEST:
                raise OSError(f"it has {LARGEST} bytes")
            self._file.write(b'{"in":%b,%b' % (received, rest[1:]))
        except OSError as error:
            print(f"gplfd: the journal ends here: {error}", file=sys.stderr, flush=True)
            self.close()

    def close(self) -> None:
        """Close the file; later messages are not written."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_journal(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal, without truncated last lines of runs."""
    lines = [line for line in path.read_bytes().split(b"\n") if line]
    if not lines or not lines[0].startswith(BEGINNING):
        raise ValueError(f"{path} is not a journal of gplfd serve")
    entries = []
    for number, line in enumerate(lines, start=1):
        try:
            entries.append(json.loads(line))
        except ValueError:
            if number < len(lines) and not lines[number].startswith(BEGINNING):
                raise ValueError(f"{path}: entry {number} is damaged") from None
    return entries
