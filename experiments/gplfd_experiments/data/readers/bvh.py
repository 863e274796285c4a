"""Biovision hierarchies (.bvh): one joint of a skeleton, by its forward kinematics.

The format has no unit of length. Positions in the frames replace a joint's OFFSET.
"""

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, Selection, chosen
from gplfd_experiments.files.arrays import FloatArray

_DEFAULT_JOINTS: Final = ("RightHand", "RightWrist")
"""Default joints; the first one that exists is used."""
_MOST_JOINTS: Final = 1000
_LONGEST_LINE: Final = 2**16
_CHANNELS: Final = {f"{a}{what}" for what in ("position", "rotation") for a in "XYZ"}


@dataclass(frozen=True, kw_only=True, slots=True)
class _Joint:
    """A joint and the place of its numbers in a frame."""

    parent: "_Joint | None"
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: dict[str, int] = field(default_factory=dict)


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a joint; errors contain the line number."""
    with path.open(encoding="utf-8", newline=None) as stream:
        number = 0

        def words_of_lines() -> Iterator[list[str]]:
            nonlocal number
            while text := stream.readline(_LONGEST_LINE):
                number += 1
                if words := text.split():
                    yield words

        lines = words_of_lines()
        try:
            joints, width = _hierarchy(lines)
            known = [name for name in _DEFAULT_JOINTS if name in joints]
            wanted = selection.body or (known or _DEFAULT_JOINTS)[0]
            name, joint = chosen(wanted, joints, "joint", file=path.name)
            period, frames = _frames(lines, width)
        except StopIteration:
            raise ValueError(f"line {number}: the file ends here, too early") from None
        except (ValueError, IndexError) as error:
            raise ValueError(f"line {number}: {error}") from error
    positions, rotations = _kinematics(joint, frames)
    return [
        RawRecording(
            name=f"{path.name}: {name}",
            times=np.asarray(np.arange(len(frames)) * period),
            positions=positions,
            unit=None,
            quaternions=rotations.as_quat(scalar_first=True),
        )
    ]


def _hierarchy(lines: Iterator[list[str]]) -> tuple[dict[str, _Joint], int]:
    """Return joints by name, and the number of values in a frame."""
    if next(lines) != ["HIERARCHY"]:
        raise ValueError("a BVH file begins with HIERARCHY")
    joints: dict[str, _Joint] = {}
    stack: list[_Joint] = []
    width = 0
    while (words := next(lines)) != ["MOTION"]:
        match words:
            case ["ROOT" | "JOINT", *name] if name:
                joint = _Joint(parent=stack[-1] if stack else None)
                joints[" ".join(name)] = joint
                stack.append(joint)
            case ["End", *_]:
                stack.append(_Joint(parent=stack[-1]))
            case ["{"]:
                pass
            case ["}"]:
                stack.pop()
            case ["OFFSET", x, y, z]:
                stack[-1].offset[:] = [float(x), float(y), float(z)]
            case ["CHANNELS", number, *names] if int(number) == len(names):
                for channel in names:
                    if channel not in _CHANNELS or channel in stack[-1].channels:
                        raise ValueError(f"{channel!r:.40} is no channel, or repeated")
                    stack[-1].channels[channel] = width
                    width += 1
            case _:
                raise ValueError(f"{' '.join(words)!r:.80} is not understood")
        if len(joints) > _MOST_JOINTS or len(stack) > _MOST_JOINTS:
            raise ValueError(f"more than {_MOST_JOINTS} joints")
    return joints, width


def _frames(lines: Iterator[list[str]], width: int) -> tuple[float, FloatArray]:
    """Return the time between frames [s], and the frames, (N, width)."""
    words = next(lines)
    if len(words) != 2 or words[0] != "Frames:":
        raise ValueError("after MOTION comes 'Frames: N'")
    number = int(words[1])
    words = next(lines)
    period = float(words[-1])
    if words[:-1] != ["Frame", "Time:"] or not 0.0 < period < 10.0:
        raise ValueError("then comes 'Frame Time: SECONDS'")
    values = array("d")
    for words in lines:
        if len(words) != width:
            raise ValueError(f"a frame has {len(words)} numbers, must have {width}")
        values.extend(map(float, words))
    frames = np.frombuffer(values).reshape(-1, max(width, 1))
    if len(frames) != number:
        raise ValueError(f"it has {len(frames)} frames, and says it has {number}")
    if not np.isfinite(frames).all():
        raise ValueError("a frame holds a number that is not finite")
    return period, frames


def _kinematics(joint: _Joint, frames: FloatArray) -> tuple[FloatArray, Rotation]:
    """Return positions and orientations of a joint in all frames."""
    chain = [joint]
    while (parent := chain[-1].parent) is not None:
        chain.append(parent)
    positions = np.zeros((len(frames), 3))
    rotations = Rotation.identity(len(frames))
    for one in reversed(chain):
        shift = np.tile(one.offset, (len(frames), 1))
        turn = Rotation.identity(len(frames))
        for channel, place in one.channels.items():
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                # As in Blender: positions replace the offset, which they include.
                shift[:, axis] = frames[:, place]
            else:
                vectors = np.zeros((len(frames), 3))
                vectors[:, axis] = frames[:, place] * (math.pi / 180.0)
                turn = turn * Rotation.from_rotvec(vectors)
        positions = positions + rotations.apply(shift)
        rotations = rotations * turn
    return positions, rotations
