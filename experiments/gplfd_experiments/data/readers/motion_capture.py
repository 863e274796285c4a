"""Motion capture: a segment of Xsens, a joint of Biovision, markers of C3D."""

import math
import re
import struct
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers.tables import UNIT_WORDS, text_of
from gplfd_experiments.data.settings import METRES, RADIANS, ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries

_DEFAULT_JOINTS: Final = ("RightHand", "RightWrist")
"""Default joints; the first one that exists is used."""
_MOTION: Final = re.compile(r"\s*Frames\s*:\s*(\d+)\s+Frame\s+Time\s*:\s*(\S+)")
_CHANNELS: Final = {f"{a}{what}" for what in ("position", "rotation") for a in "XYZ"}
_UNCOUNTED: Final = 2**16 - 1  # Last frame in the header of a longer file.
_BLOCK: Final = 512  # C3D files consist of blocks of so many bytes.
_RIGID: Final = 0.01
"""Distances of markers on a rigid body are constant to this share of its size."""
_MOSTLY: Final = 0.5  # Share of the frames with all markers in which this must be true.


class _Joint(NamedTuple):
    """A joint and the places of its numbers in a frame."""

    parent: "_Joint | None"
    offset: list[float]
    channels: dict[str, int]


def bvh(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a joint of a Biovision hierarchy, which has no unit."""
    hierarchy, _, motion = text_of(path).partition("MOTION")
    # The joints by their names, and how many numbers a frame has.
    words = (
        (number, word)
        for number, text in enumerate(hierarchy.splitlines(), start=1)
        for word in text.replace("{", " { ").replace("}", " } ").split()
    )
    joints: dict[str, list[_Joint]] = {}
    stack: list[_Joint] = []
    number = width = 0
    try:
        for line, word in words:
            number = line
            match word.upper():
                case "ROOT" | "JOINT" | "END":
                    name = [part for _, part in takewhile(lambda w: w[1] != "{", words)]
                    parent = stack[-1] if stack else None
                    stack.append(_Joint(parent, [0.0, 0.0, 0.0], {}))
                    if word.upper() != "END":
                        joints.setdefault(" ".join(name), []).append(stack[-1])
                case "}":
                    stack.pop()
                case "OFFSET":
                    stack[-1].offset[:] = [float(next(words)[1]) for _ in range(3)]
                case "CHANNELS":
                    names = [next(words)[1] for _ in range(int(next(words)[1]))]
                    if not set(names) <= _CHANNELS or len(set(names)) < len(names):
                        raise ValueError("it names no channels, or one twice")
                    places = {n: width + i for i, n in enumerate(names)}
                    stack[-1].channels.update(places)
                    width += len(names)
                case "HIERARCHY":
                    pass
                case _:
                    raise ValueError(f"{word!r:.80} is not understood")
        if stack:
            raise ValueError(f"{len(stack)} braces are not closed before MOTION")
    except (ValueError, IndexError, StopIteration) as error:
        reason = str(error) if type(error) is ValueError else "braces or numbers lack"
        raise ValueError(f"line {number}: {reason}") from error
    usual = [name for name in _DEFAULT_JOINTS if name in joints] or _DEFAULT_JOINTS
    wanted = settings.body or usual[0]
    body, (joint, *others) = chosen(wanted, joints, "joint", file=path.name)
    if others:
        raise ValueError(f"{len(others) + 1} joints are called {body}; rename them")
    head = _MOTION.match(motion)
    if head is None:
        raise ValueError("after MOTION come 'Frames: N', 'Frame Time: SECONDS'")
    count, period = int(head[1]), float(head[2])
    if not 0.0 < period < math.inf:
        raise ValueError(f"its Frame Time is {period:g} s, and must be greater than 0")
    numbers = np.array(motion[head.end() :].split(), dtype=np.float64)
    if numbers.size != count * width or not np.isfinite(numbers).all():
        raise ValueError(
            f"it says it has {count} frames of {width} finite numbers, and has "
            f"{np.isfinite(numbers).sum()} numbers: it is cut, or from another program"
        )
    positions, rotations = _kinematics(joint, numbers.reshape(count, width))
    times = np.asarray(np.arange(count) * period)
    quaternions = rotations.as_quat(scalar_first=True)
    return [RawRecording(f"{path.name}: {body}", positions, None, times, quaternions)]


def mvnx(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a segment in metres and Xsens' global frame."""
    segment = settings.body or "RightHand"
    rate, labels = 0.0, dict[str, int]()
    of_body = False  # Gloves have lists of segments of their own.
    indices: list[int] = []
    rows: dict[str, list[FloatArray]] = {"position": [], "orientation": []}
    for event, element in ElementTree.iterparse(path, ("start", "end")):
        match event, element.tag.rpartition("}")[2]:
            case "start", "subject":
                rate = float(element.get("frameRate", 0.0))
            case _, "segments":
                of_body = event == "start"
            case "start", "segment" if of_body:
                label = element.get("label", "")
                if label in labels:
                    raise ValueError(f"two segments have the label {label!r:.40}")
                labels[label] = len(labels)
            case "end", "frame":
                # Frames other than normal ones are poses of the calibration.
                if element.get("type") == "normal":
                    _, place = chosen(segment, labels, "segment", file=path.name)
                    indices.append(int(element.get("index", "")))
                    for what, width in (("position", 3), ("orientation", 4)):
                        texts = [c.text or "" for c in element if c.tag.endswith(what)]
                        numbers = np.array(" ".join(texts).split(), dtype=np.float64)
                        if numbers.size != len(labels) * width:
                            raise ValueError(
                                f"frame {indices[-1]}: {what} has {numbers.size} "
                                f"numbers, and {len(labels)} segments need "
                                f"{len(labels) * width}; export both from MVN"
                            )
                        rows[what].append(numbers.reshape(-1, width)[place])
                element.clear()
    if not indices or not rate > 0.0:
        raise ValueError("it has no frameRate, or no frame of type normal")
    positions, quaternions = map(np.array, rows.values())
    # The times in the file are rounded to milliseconds.
    times, name = np.array(indices) / rate, f"{path.name}: {segment}"
    return [RawRecording(name, positions, "m", times, quaternions)]


def _kinematics(joint: _Joint, frames: FloatArray) -> tuple[FloatArray, Rotation]:
    """Return positions and orientations of a joint in all frames."""
    positions, rotations = np.zeros((len(frames), 3)), Rotation.identity(len(frames))
    if joint.parent is not None:
        positions, rotations = _kinematics(joint.parent, frames)
    shift = np.tile(joint.offset, (len(frames), 1))
    turn = Rotation.identity(len(frames))
    for channel, place in joint.channels.items():
        axis = "XYZ".index(channel[0])
        if channel.endswith("position"):
            # As in Blender: positions replace the offset, which they include.
            shift[:, axis] = frames[:, place]
        else:
            vectors = np.zeros((len(frames), 3))
            vectors[:, axis] = frames[:, place] * RADIANS["deg"]
            turn = turn * Rotation.from_rotvec(vectors)
    return positions + rotations.apply(shift), rotations * turn


def c3d(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a marker (positions only) or of a rigid body.

    The body is given by its markers, ``--body A,B,C``: its origin is their mean, its
    axes are those of the file at the first sample that has them all.
    """
    with optional_libraries("C3D files need ezc3d", "c3d"):
        import ezc3d
    file = ezc3d.c3d(str(path))
    points, parameters = file["data"]["points"], file["parameters"]["POINT"]
    rate, count = float(file["header"]["points"]["frame_rate"]), points.shape[2]
    # ezc3d corrects the number of frames of a cut file.
    with path.open("rb") as stream:
        width, analog, first, last, start = struct.unpack("<2x4H6xH", stream.read(18))
    if not 0.0 < rate < math.inf or (last < _UNCOUNTED and count <= last - first):
        raise ValueError(
            f"it says it has {last - first + 1} frames at {rate:g} Hz, and has {count}:"
            " it is cut"
        )
    # The header counts no further, and ezc3d reads as many as it counts.
    size = (4 if parameters["SCALE"]["value"][0] < 0.0 else 2) * (4 * width + analog)
    held = path.stat().st_size - _BLOCK * (start - 1)
    if last >= _UNCOUNTED and held - count * size >= _BLOCK:
        raise ValueError(
            f"only {count} of its about {held // size} frames can be read, because its "
            f"header counts no further; export it in parts of at most {count} frames"
        )
    markers = points[:3].transpose(2, 1, 0)
    # Programs that cannot write a missing marker write zeros.
    markers = np.where((markers == 0.0).all(axis=2, keepdims=True), np.nan, markers)
    # Markers by their labels; by numbers if labels are missing.
    labels: list[str] = []
    for number in ("", *map(str, range(2, 20))):
        labels += parameters.get(f"LABELS{number}", {}).get("value", [])
    labels += map(str, range(len(labels) + 1, points.shape[1] + 1))
    labels = [label.strip() or str(n) for n, label in enumerate(labels, start=1)]
    places = {label: at for at, label in enumerate(labels[: points.shape[1]])}
    body, quaternions = settings.body, None
    if body is not None and "," in body and body not in places:
        names = [name.strip() for name in body.split(",")]
        columns = [chosen(name, places, "marker", file=path.name)[1] for name in names]
        positions, quaternions = _rigid_body(markers[:, columns], names)
    else:
        body, place = chosen(body, places, "marker", file=path.name)
        positions = markers[:, place]
    unit = "".join(parameters.get("UNITS", {}).get("value", [])[:1]).strip().lower()
    unit = UNIT_WORDS.get(unit, unit)
    if unit and unit not in METRES and settings.units is None:
        raise ValueError(
            f"POINT:UNITS is {unit!r:.40}, known are {', '.join(METRES)}; say --units"
        )
    name, times = f"{path.name}: {body}", np.arange(count) / rate
    known = unit if unit in METRES else None
    return [RawRecording(name, positions, known, times, quaternions)]


def _rigid_body(markers: FloatArray, names: list[str]) -> tuple[FloatArray, FloatArray]:
    """Return mean and orientation of markers, (N, M, 3), by Kabsch's method."""
    seen = np.isfinite(markers).all(axis=(1, 2))
    means = markers.mean(axis=1)
    arms = markers - means[:, None]
    shape = arms[np.argmax(seen)]
    quaternions = np.full((len(markers), 4), np.nan)
    problem = "no frame has all of them"
    if len(set(names)) < 3:
        problem = "it needs three"
    elif seen.any():
        size = np.linalg.svd(shape, compute_uv=False)
        for frame in np.flatnonzero(seen):
            rotation, distance = Rotation.align_vectors(arms[frame], shape)
            if distance <= math.sqrt(len(names)) * _RIGID * size[0]:
                quaternions[frame] = rotation.as_quat(scalar_first=True)
        rigid, complete = np.isfinite(quaternions[:, 0]).sum(), seen.sum()
        if size[1] >= 1e-3 * size[0] and rigid >= _MOSTLY * complete:
            return means, quaternions
        problem = (
            f"they lie on a line, or keep their distances to {_RIGID:.0%} in only "
            f"{rigid} of {complete} frames"
        )
    raise ValueError(
        f"the markers {', '.join(names)} are on no rigid body: {problem}; choose other "
        "markers, or one for positions alone"
    )
