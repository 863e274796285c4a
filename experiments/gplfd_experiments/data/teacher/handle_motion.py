"""How a person works a door: press the handle, open, let the handle go back."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher.random_motion import minimum_jerk
from gplfd_experiments.files.arrays import FloatArray

DEMONSTRATED_RADII: Final = (0.35, 0.50, 0.65)
"""Doors with a bar that the synthetic human opens [m]."""

ROOM_RADII: Final = (0.53, 0.65, 0.78)
"""Doors with a lever or knob, those of DIN leaves of 0.584, 0.709 and 0.834 m [m]."""

_TIME: Final = (0.8, 0.15)
"""Mean and standard deviation of the time in which a handle is pressed [s]."""

_SHARE: Final = (0.96, 0.03)
"""The same of the share of its travel to which it is turned; nobody turns it beyond its
stop."""

_OVERLAP: Final = 0.85
"""Share of the pressing after which a person begins to pull; the bolt is free then."""

_RETURN: Final = (math.radians(8.0), math.radians(25.0))
"""Opening angles between which the handle is let go back [rad]."""

_KEPT: Final = 0.2
"""Share of its turn that it keeps: a hand rests on it. One that took it back to its
stop would meet the stop at a speed, and whoever learns from it would, too."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Press:
    """How the handle is turned, by a person who means to open the door."""

    time: float = 0.0
    """How long it is pressed before the door is open [s]; 0 for a bar."""
    angle: float = 0.0
    """How far [rad]."""


def draw_press(door: DoorConfig, rng: np.random.Generator) -> Press:
    """Draw how a person turns a door's handle."""
    if door.handle == "bar":
        return Press()
    longer, further = rng.standard_normal(2).tolist()
    time = max(_TIME[0] + _TIME[1] * longer, 0.5 * _TIME[0])
    share = min(_SHARE[0] + _SHARE[1] * further, 1.0)
    return Press(time=time, angle=share * door.handle_travel)


def worked(
    progress: FloatArray, press: Press, opening_time: float
) -> tuple[FloatArray, FloatArray]:
    """Return what is done with handle and door as a motion goes on.

    Args:
        progress: Of the whole motion, from 0 to 1, (N,).
        press: How the handle is turned first.
        opening_time: How long the opening alone takes [s].

    Returns:
        Share of the press, and of the opening's own progress, each (N,) in [0, 1].
    """
    if press.time == 0.0:
        return np.zeros_like(progress), progress
    total = _OVERLAP * press.time + opening_time
    elapsed = total * progress
    opening = np.clip((elapsed - _OVERLAP * press.time) / opening_time, 0.0, 1.0)
    return minimum_jerk(elapsed / press.time), opening


def duration(press: Press, opening_time: float) -> float:
    """Return how long pressing and opening take together [s]."""
    return _OVERLAP * press.time + opening_time


def let_back(press: Press, share: FloatArray, angles: FloatArray) -> FloatArray:
    """Return the angles of the handle [rad], (N,).

    Args:
        press: How it is turned.
        share: Of the press, (N,).
        angles: Of the door [rad], (N,).
    """
    begins, ends = _RETURN
    back = (1.0 - _KEPT) * minimum_jerk((angles - begins) / (ends - begins))
    return press.angle * share * (1.0 - back)


def doors_like(door: DoorConfig) -> tuple[DoorConfig, ...]:
    """Return the three doors that are demonstrated to somebody who is to open a door.

    They are of its kind: its handle, latch, swing and side, and nothing else of it.
    """
    plain = door.handle == "bar"
    kind: dict[str, Any] = door.kind
    return tuple(
        DoorConfig(radius=radius, **kind)
        for radius in (DEMONSTRATED_RADII if plain else ROOM_RADII)
    )
