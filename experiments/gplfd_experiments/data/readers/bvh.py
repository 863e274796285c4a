"""Biovision hierarchies (.bvh): one joint of a skeleton, by its forward kinematics.

The format has no unit of length. Positions in the frames replace a joint's OFFSET.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.settings import RADIANS, ImportSettings
from gplfd_experiments.files.arrays import FloatArray

_DEFAULT_JOINTS: Final = ("RightHand", "RightWrist")
"""Default joints; the first one that exists is used."""
_CHANNELS: Final = {f"{a}{what}" for what in ("position", "rotation") for a in "XYZ"}


@dataclass(frozen=True, kw_only=True, slots=True)
class _Joint:
    """A joint and the place of its numbers in a frame."""

    parent: "_Joint | None"
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: dict[str, int] = field(default_factory=dict)


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a joint; errors contain the line number."""
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    joints: dict[str, _Joint] = {}
    stack: list[_Joint] = []
    number = width = begin = 0
    try:
        for number, words in enumerate(lines, start=1):
            match words:
                case ["ROOT" | "JOINT", *name] if name:
                    joint = _Joint(parent=stack[-1] if stack else None)
                    joints[" ".join(name)] = joint
                    stack.append(joint)
                case ["End", *_]:
                    stack.append(_Joint(parent=stack[-1]))
                case ["}"]:
                    stack.pop()
                case ["OFFSET", x, y, z]:
                    stack[-1].offset[:] = [float(x), float(y), float(z)]
                case ["CHANNELS", count, *names] if int(count) == len(names):
                    if not set(names) <= _CHANNELS or len(set(names)) < len(names):
                        raise ValueError("it names no channels, or one twice")
                    places = range(width, width + len(names))
                    stack[-1].channels.update(zip(names, places, strict=True))
                    width += len(names)
                case ["MOTION"]:
                    begin = number
                    break
                case [] | ["{"] | ["HIERARCHY"]:
                    pass
                case _:
                    raise ValueError(f"{' '.join(words)!r:.80} is not understood")
        known = [name for name in _DEFAULT_JOINTS if name in joints]
        wanted = settings.body or (known or _DEFAULT_JOINTS)[0]
        body, joint = chosen(wanted, joints, "joint", file=path.name)
        match [
            (at, words) for at, words in enumerate(lines[begin:], begin + 1) if words
        ]:
            case [(_, ["Frames:", count]), (_, ["Frame", "Time:", period]), *rows]:
                if len(rows) != int(count):
                    raise ValueError(f"it has {len(rows)} frames, and says {count}")
                frames = np.empty((len(rows), width))
                for place, (at, words) in enumerate(rows):
                    number = at
                    frames[place] = list(map(float, words))
            case _:
                raise ValueError("after MOTION come 'Frames: N', 'Frame Time: SECONDS'")
    except (ValueError, IndexError) as error:
        raise ValueError(f"line {number}: {error}") from error
    if not np.isfinite(frames).all():
        raise ValueError("a frame holds a number that is not finite")
    positions, rotations = _kinematics(joint, frames)
    return [
        RawRecording(
            name=f"{path.name}: {body}",
            times=np.asarray(np.arange(len(frames)) * float(period)),
            positions=positions,
            unit=None,
            quaternions=rotations.as_quat(scalar_first=True),
        )
    ]


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
