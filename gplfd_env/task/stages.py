"""How far an episode has come, in stages, and what hinders it.

The stages are those of a door of a building, as the EUROBENCH benchmark of robots at
doors counts them: take hold, turn the handle, free the latch, open, let go, close.
"""

import math
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.task.observation import DoorReading

STAGES: Final = (
    "not grasped",
    "grasped",
    "handle turned",
    "unlatched",
    "15 degrees",
    "30 degrees",
    "60 degrees",
    "90 degrees",
    "held",
    "released",
    "closed again",
)
"""By capability level."""

_GRASPED, _TURNED, _UNLATCHED = 1, 2, 3
_OPENED: Final = tuple((4 + n, math.radians(d)) for n, d in enumerate((15, 30, 60, 90)))
_HELD, _RELEASED, _CLOSED = 8, 9, 10
_CLOSED_ANGLE: Final = math.radians(1.0)

_TURN: Final = 0.5
"""Share of its travel from which a handle counts as turned."""

HEAVY_FORCE: Final = 20.0
"""Force of the hand from which something is too heavy [N]: what the friction grasp
holds in every direction."""

_REMEMBERED: Final = 0.5
"""What hindered the hand may be why it lost the handle for this long [s]."""


class Capability:
    """Counts the stages of an episode.

    Args:
        door: What holds it closed.

    Attributes:
        level: The furthest stage, a place in `STAGES`. Where nothing holds a door,
            whoever grasps it has freed it.
    """

    def __init__(self, door: DoorConfig) -> None:
        self._turned = _TURN * door.handle_travel if door.latch != "none" else 0.0
        self.level = 0

    def update(self, reading: DoorReading, *, latched: bool, held: bool) -> None:
        """Take in the state after a control period.

        Args:
            reading: Of door and grasp.
            latched: The bolt holds the door.
            held: The door has been open and held as the task asks.
        """
        level = max(self.level, _GRASPED) if reading.grasped else self.level
        if level == _GRASPED and reading.handle_angle >= self._turned:
            level = _TURNED
        if level in (_GRASPED, _TURNED) and not latched:
            level = _UNLATCHED
        if _UNLATCHED <= level < _HELD:
            for opened, angle in _OPENED:
                level = opened if reading.angle >= angle and opened > level else level
        level = max(level, _HELD) if held else level
        if level == _HELD and not reading.grasped:
            level = _RELEASED
        if level == _RELEASED and reading.angle < _CLOSED_ANGLE:
            level = _CLOSED
        self.level = level


class Hindrance:
    """Remembers what holds a strained hand back.

    Args:
        limits: Least and greatest position of every joint of the arm [rad].
    """

    def __init__(self, limits: tuple[tuple[float, float], ...]) -> None:
        self._limits = limits
        self._cause, self._since = "", 0.0

    def update(
        self, reading: DoorReading, joints: list[float], *, stalled: bool
    ) -> None:
        """Take in the state after a control period.

        Args:
            reading: Of door and grasp.
            joints: Positions of the arm's joints [rad].
            stalled: Nothing moves on, however small the force.
        """
        self._since += CONTROL_PERIOD
        if stalled or math.hypot(*reading.forces) >= HEAVY_FORCE:
            cause = self._cause_of(reading, joints)
            if cause:
                self._cause, self._since = cause, 0.0

    def _cause_of(self, reading: DoorReading, joints: list[float]) -> str:
        if reading.stop_torque > 0.0:
            return "blocked"
        for position, (low, high) in zip(joints, self._limits, strict=True):
            if not low < position < high:
                return "out_of_reach"
        return "too_heavy" if reading.forces[0] >= HEAVY_FORCE else ""

    def reason(self, failure: str) -> str:
        """Return why it failed.

        Args:
            failure: See `gplfd_env.task.opening.OpeningMonitor`.

        Returns:
            ``""`` if it has not; ``"blocked"`` (something stops the leaf),
            ``"out_of_reach"`` (a joint is at its limit) or ``"too_heavy"`` where one of
            these is why the door stalled or the handle was lost, ``"out_of_reach"``
            where that is why it was never grasped; else the failure itself.
        """
        recent = self._since <= _REMEMBERED
        if failure == "not_grasped" and recent and self._cause == "out_of_reach":
            return self._cause
        if failure not in ("stalled", "grasp_lost"):
            return failure
        lost = "handle_lost" if failure == "grasp_lost" else failure
        return self._cause if self._cause and recent else lost
