"""Frames of motions: the hand's offset, and what positions are measured from."""

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.preparation.hinge import find_hinge
from gplfd_experiments.data.preparation.samples import Note, Notes, Samples
from gplfd_experiments.data.preparation.settings import FrameName, Transform
from gplfd_experiments.files.arrays import FloatArray

_STAYS: Final = 0.75
"""A door that is opened ends at more than this share of its widest angle."""


def offset_by(samples: Samples, offset: Transform | None) -> Samples:
    """Return the motion of an object from that of what it is fixed to.

    Args:
        samples: Of the tracker.
        offset: The object's pose in the tracker's frame; None if they are one.
    """
    if offset is None:
        return samples
    positions, rotations = _parts(samples.poses)
    shift, turn = _parts(np.array(offset))
    return _of_parts(samples, positions + rotations.apply(shift), rotations * turn)


def in_frame(
    samples: Samples, frame: FrameName | Transform
) -> tuple[Samples, float | None, Notes]:
    """Express a motion in a frame.

    Args:
        samples: In the frame that was recorded.
        frame: See `Preparation.frame`.

    Returns:
        The motion; the radius of the hinge [m] if one was found; and notes.

    Raises:
        ValueError: No hinge can be found.
    """
    if frame == "recorded":
        return samples, None, ()
    positions, rotations = _parts(samples.poses)
    if frame == "hinge":
        hinge = find_hinge(positions)
        origin, axes = hinge.frame(positions[0])
        # A hand's orientation is how far it has turned, in the axes of the door.
        turned = axes.inv() * rotations * rotations[0].inv() * axes
        notes = []
        if not np.ptp(samples.poses[:, 3:], axis=0).any():
            angles = hinge.angles[:, None] * [0.0, 1.0, 0.0]
            turned = Rotation.from_rotvec(angles)
            text = "no orientations: the hand is taken to turn with the door"
            notes.append(Note(text=text))
        notes += _closed_again(hinge.angles, samples.times)
        moved = _of_parts(samples, axes.inv().apply(positions - origin), turned)
        text = (
            f"hinge at {hinge.radius:.3f} m, opened to "
            f"{np.degrees(hinge.angles.max()):.0f}°, {1e3 * hinge.residual:.1f} mm off "
            "the circle (rms)"
        )
        return moved, hinge.radius, (*notes, Note(text=text))
    base = samples.poses[0] if frame == "first-pose" else np.array(frame)
    origin, axes = _parts(base)
    moved = _of_parts(
        samples, axes.inv().apply(positions - origin), axes.inv() * rotations
    )
    return moved, None, ()


def _closed_again(angles: FloatArray, times: FloatArray) -> Notes:
    """Notice that a door does not stay open."""
    widest = int(np.argmax(angles))
    if angles[-1] > _STAYS * angles[widest]:
        return ()
    start, end = max(times[0], 0.0), times[widest]
    open_, closed = np.degrees([angles[widest], abs(angles[-1])])
    text = (
        f"opened to {open_:.0f}° after {end:.2f} s, then closed to {closed:.0f}°: to "
        f"learn to open, cut there (--segment {start:.2f}-{end:.2f})"
    )
    return (Note(text=text, warning=True),)


def _parts(poses: FloatArray) -> tuple[FloatArray, Rotation]:
    return poses[..., :3], Rotation.from_quat(poses[..., 3:], scalar_first=True)


def _of_parts(samples: Samples, positions: FloatArray, rotations: Rotation) -> Samples:
    quaternions = rotations.as_quat(scalar_first=True)
    return replace(samples, poses=np.hstack([positions, quaternions]))
