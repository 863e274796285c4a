"""Skeletons: a segment of Xsens MVN in XML (.mvnx), a joint of Biovision (.bvh).

A Biovision hierarchy has no unit; positions in its frames replace a joint's OFFSET.
"""

import re
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.settings import RADIANS, ImportSettings
from gplfd_experiments.files.arrays import FloatArray

_DEFAULT_JOINTS: Final = ("RightHand", "RightWrist")
"""Default joints; the first one that exists is used."""
_MOTION: Final = re.compile(r"\s*Frames\s*:\s*(\d+)\s+Frame\s+Time\s*:\s*(\S+)")
_CHANNELS: Final = {f"{a}{what}" for what in ("position", "rotation") for a in "XYZ"}


class _Joint(NamedTuple):
    """A joint and the places of its numbers in a frame."""

    parent: "_Joint | None"
    offset: list[float]
    channels: dict[str, int]


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a segment or joint; those of a joint are in any unit."""
    if path.suffix.lower() == ".mvnx":
        return [_segment_of_mvn(path, settings.body or "RightHand")]
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    hierarchy, _, motion = text.partition("MOTION")
    joints, width = _skeleton(hierarchy)
    usual = [name for name in _DEFAULT_JOINTS if name in joints] or _DEFAULT_JOINTS
    wanted = settings.body or usual[0]
    body, (joint, *others) = chosen(wanted, joints, "joint", file=path.name)
    if others:
        raise ValueError(f"{len(others) + 1} joints are called {body}; rename them")
    head = _MOTION.match(motion)
    if head is None:
        raise ValueError("after MOTION come 'Frames: N', 'Frame Time: SECONDS'")
    count, period = int(head[1]), float(head[2])
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


def _segment_of_mvn(path: Path, segment: str) -> RawRecording:
    """Return the motion of a segment in metres and Xsens' global frame."""
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
    return RawRecording(name, positions, "m", times, quaternions)


def _skeleton(hierarchy: str) -> tuple[dict[str, list[_Joint]], int]:
    """Return the joints by their names, and how many numbers a frame has."""
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
            match word:
                case "ROOT" | "JOINT" | "End":
                    name = [part for _, part in takewhile(lambda w: w[1] != "{", words)]
                    parent = stack[-1] if stack else None
                    stack.append(_Joint(parent, [0.0, 0.0, 0.0], {}))
                    if word != "End":
                        joints.setdefault(" ".join(name), []).append(stack[-1])
                case "}":
                    stack.pop()
                case "OFFSET":
                    stack[-1].offset[:] = [float(next(words)[1]) for _ in range(3)]
                case "CHANNELS":
                    names = [next(words)[1] for _ in range(int(next(words)[1]))]
                    if not set(names) <= _CHANNELS or len(set(names)) < len(names):
                        raise ValueError("it names no channels, or one twice")
                    stack[-1].channels.update(
                        {n: width + i for i, n in enumerate(names)}
                    )
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
    return joints, width


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
