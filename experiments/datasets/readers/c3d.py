"""C3D files of optical motion capture: a marker, or the rigid body of several.

The format is read here and not by a library: on damaged files the usual one, written in
C++, ends the process, or takes gigabytes (13 of 500). It serves the tests as an oracle.
https://www.c3d.org/HTML/default.htm describes the format.
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd.experiments.arrays import FloatArray
from gplfd.experiments.datasets.raw import RawRecording
from gplfd.experiments.datasets.readers.selection import Selection, chosen

_BLOCK: Final = 512
_MAGIC: Final = 0x50
_INTEL: Final = 84
_MOST_FRAMES: Final = 2**16 - 1
"""The header counts so far; then a parameter does, as a float."""
_KINDS: Final = {-1: "S1", 1: "u1", 2: "<i2", 4: "<f4"}
"""Types of parameters by their code."""
_UNITS: Final = {"mm": "mm", "m": "m", "cm": "cm", "in": "in", "meters": "m"}
_RIGID: Final = 0.01
"""Markers of a rigid body keep their distances to this share of its size."""

Parameters = dict[str, Any]
"""Arrays or texts by ``GROUP:NAME``."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Header:
    """What the first block says."""

    points: int
    analog: int
    """Analog numbers per frame of points."""
    first: int
    last: int
    scale: float
    """Of integer coordinates; negative where they are floats."""
    start: int
    """Byte at which the frames begin."""
    rate: float
    parameters: int
    """Byte at which the parameters begin."""


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a marker (positions only) or of a rigid body.

    The body is given by its markers, ``--body A,B,C``: its origin is their mean, its
    axes are those of the file at the first sample that has them all.

    Raises:
        ValueError: The file is damaged, of an old processor, or lacks the markers.
    """
    content = path.read_bytes()
    header = _header(content)
    parameters = _parameters(content, header.parameters)
    places = _labels(parameters, header.points)
    frames = _frames(content, header, parameters)
    body = selection.body
    if body is not None and "," in body and body not in places:
        names = [name.strip() for name in body.split(",")]
        found = [chosen(n, places, "marker", file=path.name)[1] for n in names]
        positions, quaternions = _rigid_body(frames[:, found], names)
    else:
        body, place = chosen(body, places, "marker", file=path.name)
        positions, quaternions = frames[:, place], None
    unit = str(parameters.get("POINT:UNITS", [""])[0]).strip().lower()
    if unit and unit not in _UNITS:
        raise ValueError(f"POINT:UNITS is {unit!r:.40}, known are {', '.join(_UNITS)}")
    return [
        RawRecording(
            name=f"{path.name}: {body}",
            times=np.arange(len(frames)) / header.rate,
            positions=positions,
            unit=_UNITS.get(unit),
            quaternions=quaternions,
        )
    ]


def _header(content: bytes) -> _Header:
    if len(content) < 2 * _BLOCK or content[1] != _MAGIC:
        raise ValueError("it does not begin as a C3D file does, or is cut")
    words = struct.unpack_from("<6H", content)
    (start,) = struct.unpack_from("<H", content, 16)
    (scale,), (rate,) = (struct.unpack_from("<f", content, at) for at in (12, 20))
    parameters = _BLOCK * (content[0] - 1)
    if not _BLOCK <= parameters <= len(content) - 4:
        raise ValueError(f"its parameters would begin at byte {parameters}")
    if content[parameters + 3] != _INTEL:
        raise ValueError(
            "its numbers are in the format of another processor (DEC or MIPS); save it "
            "again as Intel, for example with ezc3d"
        )
    if not 0.0 < rate < 1e6:
        raise ValueError(f"its header has the frame rate {rate}")
    return _Header(
        points=words[1],
        analog=words[2],
        first=words[3],
        last=words[4],
        scale=scale,
        start=_BLOCK * (start - 1),
        rate=rate,
        parameters=parameters,
    )


def _parameters(content: bytes, start: int) -> Parameters:
    """Return the parameters by group and name."""
    end = min(len(content), start + _BLOCK * content[start + 2])
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Any]] = []
    at = start + 4
    while at + 4 <= end and content[at]:
        length = abs(struct.unpack_from("<b", content, at)[0])
        group = struct.unpack_from("<b", content, at + 1)[0]
        name = content[at + 2 : at + 2 + length].decode("ascii", "replace").upper()
        at += 2 + length
        if at + 3 > end:
            raise ValueError(f"the parameter {name!r:.40} goes beyond its section")
        following = struct.unpack_from("<H", content, at)[0]
        if group < 0:
            groups[-group] = name
        elif group > 0:
            found.append((group, name, _parameter(content[at + 2 : end], name)))
        if not following:
            break
        at += following
    return {f"{groups.get(group, '?')}:{name}": value for group, name, value in found}


def _parameter(content: bytes, name: str) -> Any:
    """Return a parameter's array; that of letters as a list of texts."""
    kind = struct.unpack_from("<b", content)[0]
    shape = tuple(content[2 : 2 + content[1]])
    if kind not in _KINDS or len(shape) != content[1]:
        raise ValueError(f"the parameter {name!r:.40} is of no known type")
    dtype = np.dtype(_KINDS[kind])
    size = math.prod(shape) * dtype.itemsize
    data = content[2 + len(shape) : 2 + len(shape) + size]
    if len(data) != size:
        raise ValueError(f"the parameter {name!r:.40} is cut")
    if kind == -1:
        width = shape[0] if shape else 1
        texts = [data[i : i + width] for i in range(0, size, max(width, 1))]
        return [text.decode("utf-8", "replace").strip(" \0") for text in texts]
    return np.frombuffer(data, dtype)


def _labels(parameters: Parameters, points: int) -> dict[str, int]:
    """Return the places of markers by their labels."""
    labels: list[str] = []
    for number in ("", *map(str, range(2, 20))):
        labels += parameters.get(f"POINT:LABELS{number}", [])
    if len(labels) < points:
        raise ValueError(f"it has {points} markers and labels for {len(labels)}")
    return {label: place for place, label in enumerate(labels[:points]) if label}


def _frames(content: bytes, header: _Header, parameters: Parameters) -> FloatArray:
    """Return coordinates of all markers, (N, points, 3), NaN where they were lost."""
    dtype = np.dtype("<f4" if header.scale < 0.0 else "<i2")
    width = 4 * header.points + header.analog
    number = header.last - header.first + 1
    counted = parameters.get("POINT:FRAMES")
    if header.last == _MOST_FRAMES and counted is not None and counted.dtype == "<f4":
        number = int(counted[0])
    size = number * width * dtype.itemsize
    if number < 1 or not width or header.start < 0:
        raise ValueError(f"it says it has {number} frames of {header.points} markers")
    if header.start + size > len(content):
        raise ValueError(
            f"its {number} frames of {header.points} markers need {size:,} bytes from "
            f"byte {header.start:,} on; the file has {len(content):,}: it is cut"
        )
    table = np.frombuffer(content, dtype, number * width, header.start)
    points = table.reshape(number, width)[:, : 4 * header.points]
    points = points.reshape(number, header.points, 4).astype(np.float64)
    lost = points[..., 3] < 0.0
    scale = 1.0 if header.scale < 0.0 else header.scale
    coordinates = points[..., :3] * scale
    coordinates[lost] = np.nan
    return np.asarray(coordinates)


def _rigid_body(markers: FloatArray, names: list[str]) -> tuple[FloatArray, FloatArray]:
    """Return mean and orientation of markers, (N, M, 3), by Kabsch's method."""
    if len(set(names)) < 3:
        raise ValueError(f"a rigid body needs three markers, got {', '.join(names)}")
    seen = np.isfinite(markers).all(axis=(1, 2))
    if not seen.any():
        raise ValueError(f"no frame has all of the markers {', '.join(names)}")
    means = markers.mean(axis=1)
    arms = markers - means[:, None]
    shape = arms[np.argmax(seen)]
    size = np.linalg.svd(shape, compute_uv=False)
    if size[1] < 1e-3 * size[0]:
        raise ValueError(f"the markers {', '.join(names)} lie on a line")
    quaternions = np.full((len(markers), 4), np.nan)
    for frame in np.flatnonzero(seen):
        rotation, distance = Rotation.align_vectors(arms[frame], shape)
        if distance > math.sqrt(len(names)) * _RIGID * size[0]:
            continue
        quaternions[frame] = rotation.as_quat(scalar_first=True)
    return means, quaternions
