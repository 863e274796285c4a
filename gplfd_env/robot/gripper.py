"""Commands of a gripper that opens and closes during an episode."""

import math
from collections.abc import Sequence
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH
from gplfd_env.doors.config import DoorConfig, held_radius

SPEED: Final = 0.1
"""Rate limit of the commanded width: 0.05 m/s per finger, as on TIAGo [m/s]."""
AT_HANDLE: Final = (0.01, 0.1)
"""A gripper without a command closes if the hand is within this distance of the pose of
the closed grasp [m, rad]."""
AT_REST: Final = (0.09, 0.002, 0.25)
"""If the handle's position is uncertain, a gripper without a command closes when the
hand is within this distance of the believed grasp [m] and has moved by less than this
[m] for this long [s] ..."""
RELEASE_DISTANCE: Final = 0.04
"""... and opens again when the empty hand is this far from that place [m]."""


class Gripper:
    """Width of the fingers [m], rate-limited; the handle may be `uncertain`."""

    def __init__(self, door: DoorConfig, width: float, *, uncertain: bool) -> None:
        self._thickness = 2.0 * held_radius(door.handle)
        self.width = width
        self.uncertain = uncertain
        self._place: tuple[float, ...] = (math.inf, 0.0, 0.0)
        self._rested = 0.0

    @property
    def opened(self) -> bool:
        """Whether the commanded width exceeds the thickness of the handle."""
        return self.width > self._thickness

    def obey(self, width: float) -> None:
        """Move towards a commanded width [m], clamped to [0, `GRIPPER_WIDTH`]."""
        step = SPEED * CONTROL_PERIOD
        change = min(max(width, 0.0), GRIPPER_WIDTH) - self.width
        self.width += min(max(change, -step), step)

    def close_at_handle(self, hand: Sequence[float], *, taken: bool) -> None:
        """Close if the hand (6,) holds the handle, is there, or rests near it."""
        away = math.hypot(*hand[:3])
        closes = away <= AT_HANDLE[0] and math.hypot(*hand[3:]) <= AT_HANDLE[1]
        if self.uncertain:
            moved = math.dist(hand[:3], self._place)
            closing = self._rested >= AT_REST[2]
            if moved > (RELEASE_DISTANCE if closing else AT_REST[1]):
                self._place, self._rested = tuple(hand[:3]), 0.0
            elif not closing and away <= AT_REST[0]:
                self._rested += CONTROL_PERIOD
            closes = self._rested >= AT_REST[2]
        self.obey(0.0 if taken or closes else GRIPPER_WIDTH)
