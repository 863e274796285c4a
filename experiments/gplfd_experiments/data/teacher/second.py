"""A second synthetic human, which shares no code with the first.

Rankings and constants that hold for one synthetic human only are artefacts of it. This
human hooks the handle, which slides through the hand; the wrist turns less or more than
the leaf; the speed is a trapezoid; the hand trembles; and the axes of the recording
differ from those of the door by a few degrees.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.motion import end_angle
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.demonstration import Demonstration

_RATE: Final = 50.0  # Of the recording [Hz].
_SLIDE: Final = 0.03  # Largest distance by which the handle slides in the hand [m].
_WRIST: Final = (0.7, 1.2)  # Turn of the hand over that of the handle.
_TREMOR: Final = 0.001  # Amplitude [m].
_FREQUENCY: Final = (8.0, 12.0)  # Range of that of the tremor [Hz].
_HEADING: Final = np.radians(2.0)  # Standard deviation of the axes' heading [rad].
_NOISE: Final = (0.0005, 0.003)  # White noise of the recording per axis [m, rad].


def trapezoid(progress: FloatArray, rise: float, fall: float) -> FloatArray:
    """Return the share of a way at a share of its time, both (N,) in [0, 1].

    The speed rises and falls linearly during shares `rise` and `fall` of the time.
    """
    t = np.clip(progress, 0.0, 1.0)
    way = t - 0.5 * rise
    way = np.where(t < rise, 0.5 * t**2 / rise, way)
    end = 1.0 - 0.5 * rise - 0.5 * fall
    way = np.where(t > 1.0 - fall, end - 0.5 * (1.0 - t) ** 2 / fall, way)
    return np.asarray(way / end)


def demonstrate(
    door: DoorConfig, angle: float, rng: np.random.Generator
) -> Demonstration:
    """Open a door to about an angle [rad] and return the recording.

    The poses [m, rad] are relative to the first sample, in the axes of the door.
    """
    final = angle + np.radians(rng.uniform(-3.0, 3.0))
    if door.motion != "hinged":  # It stops at its frame.
        final = min(final, end_angle(door) - np.radians(1.0))
    pressing = 0.0 if door.handle == "bar" else rng.uniform(0.6, 1.2)
    opening = rng.uniform(4.0, 9.0)
    times = np.arange(round((pressing + opening) * _RATE) + 1) / _RATE
    rise, fall = rng.uniform(0.1, 0.4, 2)
    angles = final * trapezoid((times - pressing) / opening, rise, fall)
    turns = np.zeros(times.size)
    if pressing:
        turns += door.handle_travel * trapezoid(times / pressing, 0.5, 0.5)
    path = DoorGeometry.of(door).easy_hand_poses(angles, turns)
    handle = Rotation.from_rotvec(path[:, 3:])
    slide = np.outer(trapezoid(times / times[-1], rise, fall), rng.uniform(-1, 1, 3))
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    tremor = np.sin(2.0 * np.pi * rng.uniform(*_FREQUENCY) * times[:, None] + phases)
    positions = path[:, :3] + _TREMOR * tremor
    positions += handle.apply(_SLIDE * slide / np.sqrt(3.0))
    hand = Rotation.from_rotvec(rng.uniform(*_WRIST) * path[:, 3:])
    axes = Rotation.from_rotvec([0.0, rng.normal(0.0, _HEADING), 0.0])
    place, turn = _NOISE
    moved = axes.apply(positions - positions[0])
    moved += rng.normal(0.0, place, path[:, :3].shape)
    turned = Rotation.from_rotvec(rng.normal(0.0, turn, path[:, :3].shape))
    turned = turned * (axes * (hand * hand[0].inv()) * axes.inv())
    poses = np.hstack([moved, (turned * turned[0].inv()).as_rotvec()])
    poses[:, :3] -= poses[0, :3]
    return Demonstration(times=times, poses=poses)


def demonstrate_doors(
    doors: Sequence[DoorConfig], per_door: int, angle: float, rng: np.random.Generator
) -> tuple[Demonstration, ...]:
    """Open each door several times to an angle [rad], in the given order of doors."""
    return tuple(
        demonstrate(door, angle, hand)
        for door, door_rng in zip(doors, rng.spawn(len(doors)), strict=True)
        for hand in door_rng.spawn(per_door)
    )
