"""Motion of a person who reaches for a handle, presses it and opens the door."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher.random_motion import minimum_jerk, uneven_timing
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.reaching import GRASPED, join_at_grasp
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

DEMONSTRATED_RADII: Final = (0.35, 0.50, 0.65)
"""Radii of the demonstrated doors with a bar [m]."""
ROOM_RADII: Final = (0.53, 0.65, 0.78)
"""Radii of doors with a lever or knob, for DIN leaves of 0.584, 0.709, 0.834 m [m]."""
_RADII: Final[Mapping[str, tuple[float, float, float]]] = {
    "sliding": (0.55, 0.70, 0.85),
    "parallel-sliding": (0.45, 0.60, 0.75),
    "folding": (0.44, 0.54, 0.64),
    "flap": (0.32, 0.38, 0.44),
    "rising-butt": ROOM_RADII,
}
"""The same for other motions."""
_SHAPE: Final = {
    "parallel-sliding": ("mechanism", "offset"),
    "folding": ("leaf", "backset"),
}
"""Fields that determine the path in addition to the radius."""

# Pressing the handle: means and standard deviations.
_PRESS_TIME: Final = (0.8, 0.15)  # Time in which the handle is pressed [s].
_PRESS_SHARE: Final = (0.96, 0.03)  # Share of its travel, at most to its stop.
_OVERLAP: Final = 0.85
"""Share of the pressing after which a person begins to pull; the bolt is then free."""
_RETURN: Final = (math.radians(8.0), math.radians(25.0))
"""Range of opening angles in which the handle returns [rad]."""
_KEPT: Final = 0.2
"""Share of its rotation that the handle keeps, because a hand rests on it."""

# Reaching for the handle.
_DISTANCE: Final = (0.10, 0.25)  # Smallest and largest distance at the start [m].
_DIRECTION: Final = 0.6
"""Largest angle between start and normal of the door, sideways or vertically [rad]."""
_TURN: Final = 0.1  # Standard deviation per axis of the hand's rotation there [rad].
_ARCH: Final = 0.01
"""Standard deviation per axis of the path's distance from the straight line [m]."""
_REACH_TIME: Final = (1.6, 0.2)  # Mean and standard deviation [s].
_GRIP_TIME: Final = (0.4, 0.1)  # The same of the time in which the hand closes [s].


class Press(NamedTuple):
    """Duration [s] and angle [rad] of turning the handle; zero for a bar."""

    time: float = 0.0
    angle: float = 0.0


def draw_press(door: DoorConfig, rng: np.random.Generator) -> Press:
    """Draw the motion of a door's handle."""
    if door.handle == "bar":
        return Press()
    longer, further = rng.standard_normal(2).tolist()
    time = max(_PRESS_TIME[0] + _PRESS_TIME[1] * longer, 0.5 * _PRESS_TIME[0])
    share = min(_PRESS_SHARE[0] + _PRESS_SHARE[1] * further, 1.0)
    return Press(time=time, angle=share * door.handle_travel)


def duration(press: Press, opening_time: float) -> float:
    """Return the duration of pressing and opening together [s]."""
    return _OVERLAP * press.time + opening_time


def press_and_opening(
    progress: FloatArray, press: Press, opening_time: float
) -> tuple[FloatArray, FloatArray]:
    """Return the progress of pressing and of opening, at that of the whole, (N,)."""
    if press.time == 0.0:
        return np.zeros_like(progress), progress
    elapsed = duration(press, opening_time) * progress
    opening = np.clip((elapsed - _OVERLAP * press.time) / opening_time, 0.0, 1.0)
    return minimum_jerk(elapsed / press.time), opening


def handle_angles(press: Press, share: FloatArray, angles: FloatArray) -> FloatArray:
    """Return handle angles [rad] for progress of pressing and door angles."""
    begins, ends = _RETURN
    back = (1.0 - _KEPT) * minimum_jerk((angles - begins) / (ends - begins))
    return press.angle * share * (1.0 - back)


def doors_like(door: DoorConfig) -> tuple[DoorConfig, ...]:
    """Return the three demonstrated doors of a door's kind: three sizes, one shape."""
    radii = DEMONSTRATED_RADII if door.handle == "bar" else ROOM_RADII
    radii = _RADII.get(door.motion, radii)
    kind: dict[str, Any] = door.kind
    if door.motion in _SHAPE:
        part, name = _SHAPE[door.motion]
        kind[part] = {name: getattr(getattr(door, part), name)}
    return tuple(DoorConfig(radius=radius, **kind) for radius in radii)


def reach_motion(
    rate: float, timing_std: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, Rotation]:
    """Return the motion of a hand that reaches the handle and closes, ending at time 0.

    Times (N,) [s], positions (N, 3) [m] from the handle, in door axes, and N rotations
    relative to the grasp. The motion along a gentle arch is unevenly timed.
    """
    distance = rng.uniform(*_DISTANCE)
    aside, above = rng.uniform(-_DIRECTION, _DIRECTION, 2)
    level = np.cos(above)
    direction = np.array([level * np.cos(aside), np.sin(above), level * np.sin(aside)])
    turned, arch = rng.standard_normal((2, 3))
    longer, slower = rng.standard_normal(2)
    reaching = max(_REACH_TIME[0] + _REACH_TIME[1] * longer, 0.5 * _REACH_TIME[0])
    gripping = max(_GRIP_TIME[0] + _GRIP_TIME[1] * slower, 0.5 * _GRIP_TIME[0])
    samples = round((reaching + gripping) * rate)
    times = np.arange(-samples, 1) / rate
    clock = np.clip((times - times[0]) / reaching, 0.0, 1.0)
    done = minimum_jerk(uneven_timing(clock, timing_std, rng))[:, None]
    from_line = np.sin(np.pi * done) ** 2 * (_ARCH * arch)
    positions = (1.0 - done) * (distance * direction) + from_line
    return times, positions, Rotation.from_rotvec((1.0 - done) * (_TURN * turned))


def with_reaches(
    reaches: Sequence[Demonstration],
    openings: Sequence[Demonstration],
    radii: Sequence[float | None],
) -> LabelledDemonstrations:
    """Join reaches and openings of doors with radii [m], or None.

    A signal says whether the hand holds the handle.
    """
    whole = tuple(map(join_at_grasp, reaches, openings))
    grasped = [
        {GRASPED: (joined.times[:, None] >= 0.0).astype(float)} for joined in whole
    ]
    return LabelledDemonstrations(
        demonstrations=whole, radii=tuple(radii), signals=tuple(grasped)
    )
