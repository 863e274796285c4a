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
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.selection import Selection, chosen
from gplfd_experiments.files.arrays import FloatArray

_BLOCK: Final = 512
_MAGIC: Final = 0x50
_MOST_BLOCKS: Final = 255
"""Of parameters; a byte counts them."""
_MOST_FRAMES: Final = 2**16 - 1
"""The header counts so far; then a parameter does, as a float."""
_KINDS: Final = {-1: "S1", 1: "u1", 2: "i2", 4: "f4"}
"""Types of parameters by their code."""
_UNITS: Final = {"mm": "mm", "m": "m", "cm": "cm", "in": "in", "meters": "m"}
_RIGID: Final = 0.01
"""Markers of a rigid body keep their distances to this share of its size."""

_MOSTLY: Final = 0.5
"""Share of the frames with all markers in which they do so."""

Parameters = dict[str, Any]
"""Arrays or texts by ``GROUP:NAME``."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Processor:
    """How the computer that wrote the file holds numbers."""

    order: str
    """Of bytes, "<" or ">"."""
    vax: bool = False
    """Whether floats are those of a VAX: the high word first, four times as large."""

    def numbers(self, content: bytes, kind: str) -> NDArray[Any]:
        """Return numbers of a type of NumPy's without its order, "i2" or "f4"."""
        if kind == "f4" and self.vax:
            words = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
            return np.asarray(words.copy().view("<f4").ravel() / np.float32(4.0))
        return np.frombuffer(content, self.order + kind)


_PROCESSORS: Final = {
    84: _Processor(order="<"),
    85: _Processor(order="<", vax=True),
    86: _Processor(order=">"),
}
"""Intel, DEC and MIPS (SGI) by the code in a file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Header:
    """What the first block says."""

    processor: _Processor
    points: int
    analog: int
    """Analog numbers per frame of points."""
    sampled: int
    """How often a frame samples each analog channel."""
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
        ValueError: The file is damaged, or lacks the markers.
    """
    content = path.read_bytes()
    header = _header(content)
    parameters = _parameters(content, header)
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
    if unit and unit not in _UNITS and selection.units is None:
        raise ValueError(
            f"POINT:UNITS is {unit!r:.40}, known are {', '.join(_UNITS)}; say --units"
        )
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
    parameters = _BLOCK * (content[0] - 1)
    if not _BLOCK <= parameters <= len(content) - 4:
        raise ValueError(f"its parameters would begin at byte {parameters}")
    processor = _PROCESSORS.get(content[parameters + 3])
    if processor is None:
        raise ValueError(f"it is of an unknown processor, {content[parameters + 3]}")
    words = processor.numbers(content[:20], "u2").tolist()
    scale, rate = (processor.numbers(content[a : a + 4], "f4")[0] for a in (12, 20))
    if not 0.0 < rate < 1e6:
        raise ValueError(f"its header has the frame rate {rate}")
    return _Header(
        processor=processor,
        points=words[1],
        analog=words[2],
        sampled=words[9],
        first=words[3],
        last=words[4],
        scale=float(scale),
        start=_BLOCK * (words[8] - 1),
        rate=float(rate),
        parameters=parameters,
    )


def _parameters(content: bytes, header: _Header) -> Parameters:
    """Return the parameters by group and name."""
    start = header.parameters
    # Some programs count too few blocks; but before the frames they end.
    before = min(_MOST_BLOCKS, (header.start - start) // _BLOCK)
    end = min(len(content), start + _BLOCK * max(content[start + 2], before))
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
        following = int(header.processor.numbers(content[at : at + 2], "u2")[0])
        if group < 0:
            groups[-group] = name
        elif group > 0:
            value = _parameter(content[at + 2 : end], name, header.processor)
            found.append((group, name, value))
        if not following:
            break
        at += following
    return {f"{groups.get(group, '?')}:{name}": value for group, name, value in found}


def _parameter(content: bytes, name: str, processor: _Processor) -> Any:
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
    return processor.numbers(data, _KINDS[kind])


def _labels(parameters: Parameters, points: int) -> dict[str, int]:
    """Return the places of markers by their labels, or numbers if there are fewer."""
    labels: list[str] = []
    for number in ("", *map(str, range(2, 20))):
        labels += parameters.get(f"POINT:LABELS{number}", [])
    labels += [str(place + 1) for place in range(len(labels), points)]
    return {label: place for place, label in enumerate(labels[:points]) if label}


def _frames(content: bytes, header: _Header, parameters: Parameters) -> FloatArray:
    """Return coordinates of all markers, (N, points, 3), NaN where they were lost."""
    kind, size = ("f4", 4) if header.scale < 0.0 else ("i2", 2)
    number = header.last - header.first + 1
    counted = parameters.get("POINT:FRAMES")
    most = header.last == _MOST_FRAMES
    if most and counted is not None and counted.dtype.kind == "f":
        number = int(counted[0])
    if number < 1 or not header.points + header.analog or header.start < 0:
        raise ValueError(f"it says it has {number} frames of {header.points} markers")
    room = (len(content) - header.start) // (number * size)
    width = 4 * header.points + header.analog
    # Some programs count a channel once, however often a frame samples it.
    every = 4 * header.points + header.analog * header.sampled
    if header.analog in parameters.get("ANALOG:USED", ()) and every <= room:
        width = every
    if width > room:
        raise ValueError(
            f"its {number} frames of {header.points} markers need "
            f"{number * width * size:,} bytes from byte {header.start:,} on; the file "
            f"has {len(content):,}: it is cut"
        )
    end = header.start + number * width * size
    table = header.processor.numbers(content[header.start : end], kind)
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
    complete = np.count_nonzero(seen)
    rigid = np.count_nonzero(np.isfinite(quaternions[:, 0]))
    if rigid < _MOSTLY * complete:
        raise ValueError(
            f"the markers {', '.join(names)} keep their distances to {_RIGID:.0%} in "
            f"{rigid} of {complete} frames that have them all: they are on no rigid "
            "body; choose others, or one for positions alone"
        )
    return means, quaternions
