"""Stages of an episode, and the diagnosis of a failure.

The stages follow the EUROBENCH benchmark for robots that open doors: grasp, turn the
handle, unlatch, open, release, close. Numbers are for one simulation, or arrays (n,).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.conventions.one_and_many import (
    Flag,
    Number,
    anywhere,
    hypot,
    larger,
    negated,
    where,
)
from gplfd_env.doors.config import DoorConfig
from gplfd_env.task.observation import DoorReading
from gplfd_env.task.opening import FAILURES, GRASP_LOST, NOT_GRASPED, STALLED

STAGES: Final = (
    *("not grasped", "grasped", "handle turned", "unlatched"),
    *("15 degrees", "30 degrees", "60 degrees", "90 degrees"),
    *("held", "released", "closed again"),
)
"""Stages by number."""

_GRASPED, _TURNED, _UNLATCHED = 1, 2, 3
_OPENED: Final = tuple(math.radians(degrees) for degrees in (15, 30, 60, 90))
_HELD, _RELEASED, _CLOSED = 8, 9, 10
_CLOSED_ANGLE: Final = math.radians(1.0)
_TURN: Final = 0.5  # Share of its travel beyond which a handle counts as turned.

REASONS: Final = (*FAILURES, "blocked", "out_of_reach", "too_heavy", "handle_lost")
"""Reasons why an episode fails, by number: one of `FAILURES`, or its cause."""

_BLOCKED, _OUT_OF_REACH, _TOO_HEAVY, _HANDLE_LOST = range(len(FAILURES), len(REASONS))

HEAVY_FORCE: Final = 20.0
"""Force of the hand above which a door counts as too heavy [N]: the friction grasp
holds this force in every direction."""

# Time for which a cause is remembered as the reason of a lost handle [s].
_REMEMBERED: Final = 0.5


def turned_angle(door: DoorConfig) -> float:
    """Return the angle beyond which a handle counts as turned [rad]; 0 if unlatched."""
    return _TURN * door.handle_travel if door.latch != "none" else 0.0


def stage_after(
    stage: Number, reading: DoorReading, turned: Number, latched: Flag, held: Flag
) -> Number:
    """Return the furthest stage after a control period, an index into `STAGES`.

    A door without a latch is unlatched as soon as it is grasped. `turned` is the result
    of `turned_angle`; `held`: the door has been open and held as the task requires.
    """
    stage = where(reading.grasped & (stage < _GRASPED), _GRASPED, stage)
    if anywhere(stage < _UNLATCHED):
        turns = (stage == _GRASPED) & (reading.handle_angle >= turned)
        stage = where(turns, _TURNED, stage)
        freed = ((stage == _GRASPED) | (stage == _TURNED)) & negated(latched)
        stage = where(freed, _UNLATCHED, stage)
    opening = (stage >= _UNLATCHED) & (stage < _HELD)
    if anywhere(opening & (reading.angle >= _OPENED[0])):
        opened = sum(1 * (reading.angle >= angle) for angle in _OPENED)
        stage = where(opening, larger(stage, _UNLATCHED + opened), stage)
    stage = where(held & (stage < _HELD), _HELD, stage)
    if anywhere(stage >= _HELD):
        released = (stage == _HELD) & negated(reading.grasped)
        stage = where(released, _RELEASED, stage)
        closed = (stage == _RELEASED) & (reading.angle < _CLOSED_ANGLE)
        stage = where(closed, _CLOSED, stage)
    return stage


@dataclass(slots=True)
class Diagnosis:
    """Remembers the cause of a high force or a stall, as an index into `REASONS`."""

    cause: Number = 0
    age: Number = 0.0  # Time since it was the cause [s].

    def update(
        self,
        reading: DoorReading,
        joints: Sequence[Number],
        limits: Sequence[tuple[float, float]],
        stalled: Flag,
    ) -> None:
        """Update from the arm's joints [rad] and whether the door has stalled."""
        self.age = self.age + CONTROL_PERIOD
        strained = stalled | (hypot(*reading.forces) >= HEAVY_FORCE)
        if not anywhere(strained):
            return
        at_limit: Flag = False
        for position, (low, high) in zip(joints, limits, strict=True):
            at_limit = at_limit | (position <= low) | (position >= high)
        cause = where(reading.forces[0] >= HEAVY_FORCE, _TOO_HEAVY, 0)
        cause = where(at_limit, _OUT_OF_REACH, cause)
        cause = where(reading.stop_torque > 0.0, _BLOCKED, cause)
        caused = strained & (cause != 0)
        self.cause = where(caused, cause, self.cause)
        self.age = where(caused, 0.0, self.age)

    def reason(self, failure: Number) -> Number:
        """Return the reason of a failure, an index into `REASONS`.

        If the door stalled or the handle was lost, a recent cause is the reason:
        ``"blocked"`` (something stops the leaf), ``"out_of_reach"`` (a joint is at its
        limit) or ``"too_heavy"``. If the handle was never grasped, only
        ``"out_of_reach"`` can be the reason. Else it is the failure itself.
        """
        if not anywhere(failure != 0):
            return failure
        recent = (self.age <= _REMEMBERED) & (self.cause != 0)
        lost = failure == GRASP_LOST
        caused = recent & ((failure == STALLED) | lost)
        reached = (failure == NOT_GRASPED) & (self.cause == _OUT_OF_REACH)
        reason = where(lost, _HANDLE_LOST, failure)
        return where(caused | (recent & reached), self.cause, reason)
