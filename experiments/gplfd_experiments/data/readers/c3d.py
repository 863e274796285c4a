"""C3D files of optical motion capture: a marker, or the rigid body of several.

https://www.c3d.org/HTML/default.htm describes the format. This module replaces the
usual library, which ends the process or takes gigabytes on damaged files (13 of 500).
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, Selection, chosen
from gplfd_experiments.files.arrays import FloatArray

_Decode = Callable[[bytes, str], NDArray[Any]]
"""Returns the numbers in bytes, for a NumPy type without byte order."""

_BLOCK: Final = 512
_MAGIC: Final = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86  # Processors with different number formats.
_MOST_BLOCKS: Final = 255  # Largest number of parameters; their count is a byte.
_MOST_FRAMES: Final = 2**16 - 1
"""The header counts up to this number; larger counts are in a float parameter."""
_KINDS: Final = {-1: "S1", 1: "u1", 2: "i2", 4: "f4"}  # Types of parameters.
_UNITS: Final = {"mm": "mm", "m": "m", "cm": "cm", "in": "in", "meters": "m"}
_RIGID: Final = 0.01
"""Distances of markers on a rigid body are constant to this share of its size."""
_MOSTLY: Final = 0.5  # Share of the frames with all markers in which this must be true.


def _numbers(processor: int, content: bytes, kind: str) -> NDArray[Any]:
    """Return the decoder of numbers of a processor."""
    if kind == "f4" and processor == _DEC:
        # The high word first, and four times as large.
        words = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
        return np.asarray(words.copy().view("<f4").ravel() / np.float32(4.0))
    return np.frombuffer(content, (">" if processor == _MIPS else "<") + kind)


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a marker (positions only) or of a rigid body.

    The body is given by its markers, ``--body A,B,C``: its origin is their mean, its
    axes are those of the file at the first sample that has them all.
    """
    content = path.read_bytes()
    if len(content) < 2 * _BLOCK or content[1] != _MAGIC:
        raise ValueError("it does not begin as a C3D file does, or is cut")
    start = _BLOCK * (content[0] - 1)
    if not _BLOCK <= start <= len(content) - 4:
        raise ValueError(f"its parameters would begin at byte {start}")
    processor = content[start + 3]
    if processor not in (_INTEL, _DEC, _MIPS):
        raise ValueError(f"it is of an unknown processor, {processor}")
    decode = partial(_numbers, processor)
    header = decode(content[:20], "u2").tolist()
    _, points, analog, first, last, _, _, _, block, sampled = header
    scale, rate = (float(decode(content[at : at + 4], "f4")[0]) for at in (12, 20))
    if not 0.0 < rate < 1e6:
        raise ValueError(f"its header has the frame rate {rate}")
    begin = _BLOCK * (block - 1)
    parameters = _parameters(content, start, begin, decode)
    # Markers by their labels; by numbers if labels are missing.
    labels: list[str] = []
    for number in ("", *map(str, range(2, 20))):
        labels += parameters.get(f"POINT:LABELS{number}", [])
    labels += [str(place + 1) for place in range(len(labels), points)]
    places = {label: place for place, label in enumerate(labels[:points]) if label}
    # Frames of four numbers per marker, x, y, z and what was seen of it, and of analog
    # channels.
    frames = last - first + 1
    counted = parameters.get("POINT:FRAMES")
    if last == _MOST_FRAMES and counted is not None and counted.dtype.kind == "f":
        frames = int(counted[0])
    if frames < 1 or not points + analog or begin < 0:
        raise ValueError(f"it says it has {frames} frames of {points} markers")
    kind, size = ("f4", 4) if scale < 0.0 else ("i2", 2)
    room = (len(content) - begin) // (frames * size)
    width = 4 * points + analog
    # Some programs count a channel once, for any number of samples per frame.
    every = 4 * points + analog * sampled
    if analog in parameters.get("ANALOG:USED", ()) and every <= room:
        width = every
    if width > room:
        raise ValueError(
            f"its {frames} frames of {points} markers need "
            f"{frames * width * size:,} bytes from byte {begin:,} on; the file "
            f"has {len(content):,}: it is cut"
        )
    numbers = decode(content[begin : begin + frames * width * size], kind)
    table = numbers.reshape(frames, width)[:, : 4 * points]
    table = table.reshape(frames, points, 4).astype(np.float64)
    markers = table[..., :3] * (1.0 if scale < 0.0 else scale)
    markers[table[..., 3] < 0.0] = np.nan
    body, quaternions = selection.body, None
    if body is not None and "," in body and body not in places:
        names = [name.strip() for name in body.split(",")]
        found = [chosen(n, places, "marker", file=path.name)[1] for n in names]
        positions, quaternions = _rigid_body(markers[:, found], names)
    else:
        body, place = chosen(body, places, "marker", file=path.name)
        positions = markers[:, place]
    unit = str(parameters.get("POINT:UNITS", [""])[0]).strip().lower()
    if unit and unit not in _UNITS and selection.units is None:
        raise ValueError(
            f"POINT:UNITS is {unit!r:.40}, known are {', '.join(_UNITS)}; say --units"
        )
    return [
        RawRecording(
            name=f"{path.name}: {body}",
            times=np.arange(frames) / rate,
            positions=positions,
            unit=_UNITS.get(unit),
            quaternions=quaternions,
        )
    ]


def _parameters(
    content: bytes, start: int, frames: int, decode: _Decode
) -> dict[str, Any]:
    """Return the parameters between two bytes, arrays or texts by ``GROUP:NAME``."""
    # Some programs count too few blocks, but the section ends before the frames.
    before = min(_MOST_BLOCKS, (frames - start) // _BLOCK)
    end = min(len(content), start + _BLOCK * max(content[start + 2], before))
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Any]] = []
    at = start + 4
    while at + 4 <= end and content[at]:
        length, group = np.frombuffer(content[at : at + 2], "i1").tolist()
        name_end = at + 2 + abs(length)
        name = content[at + 2 : name_end].decode("ascii", "replace").upper()
        at = name_end
        if at + 3 > end:
            raise ValueError(f"the parameter {name!r:.40} goes beyond its section")
        following = int(decode(content[at : at + 2], "u2")[0])
        if group < 0:
            groups[-group] = name
        elif group > 0:
            rest = content[at + 2 : end]
            kind = int(np.frombuffer(rest[:1], "i1")[0])
            shape = tuple(rest[2 : 2 + rest[1]])
            if kind not in _KINDS or len(shape) != rest[1]:
                raise ValueError(f"the parameter {name!r:.40} is of no known type")
            size = math.prod(shape) * np.dtype(_KINDS[kind]).itemsize
            data = rest[2 + len(shape) : 2 + len(shape) + size]
            if len(data) != size:
                raise ValueError(f"the parameter {name!r:.40} is cut")
            value: Any
            if kind == -1:
                width = shape[0] if shape else 1
                texts = [data[i : i + width] for i in range(0, size, max(width, 1))]
                value = [one.decode("utf-8", "replace").strip(" \0") for one in texts]
            else:
                value = decode(data, _KINDS[kind])
            found.append((group, name, value))
        if not following:
            break
        at += following
    return {f"{groups.get(group, '?')}:{name}": value for group, name, value in found}


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
        if distance <= math.sqrt(len(names)) * _RIGID * size[0]:
            quaternions[frame] = rotation.as_quat(scalar_first=True)
    complete = np.count_nonzero(seen)
    rigid = np.count_nonzero(np.isfinite(quaternions[:, 0]))
    if rigid < _MOSTLY * complete:
        raise ValueError(
            f"the markers {', '.join(names)} keep their distances to {_RIGID:.0%} in "
            f"{rigid} of {complete} frames that have them all: they are not on a rigid "
            "body; choose other markers, or one for positions alone"
        )
    return means, quaternions
