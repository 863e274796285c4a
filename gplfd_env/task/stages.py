"""How far an episode has come, in stages, and the diagnosis of a failure.

The stages are those of a door of a building, as the EUROBENCH benchmark of robots at
doors counts them: take hold, turn the handle, free the latch, open, let go, close.
Numbers are of one simulation, or arrays (n,).
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
"""By number."""

_GRASPED, _TURNED, _UNLATCHED = 1, 2, 3
_OPENED: Final = tuple(math.radians(degrees) for degrees in (15, 30, 60, 90))
_HELD, _RELEASED, _CLOSED = 8, 9, 10
_CLOSED_ANGLE: Final = math.radians(1.0)

_TURN: Final = 0.5
"""Share of its travel from which a handle counts as turned."""

REASONS: Final = (*FAILURES, "blocked", "out_of_reach", "too_heavy", "handle_lost")
"""Why an episode fails, by number: one of `FAILURES`, or what is behind it."""

_BLOCKED, _OUT_OF_REACH, _TOO_HEAVY, _HANDLE_LOST = range(len(FAILURES), len(REASONS))

HEAVY_FORCE: Final = 20.0
"""Force of the hand from which something is too heavy [N]: what the friction grasp
holds in every direction."""

_REMEMBERED: Final = 0.5
"""For this long a cause is remembered as the reason for a lost handle [s]."""


def turned_angle(door: DoorConfig) -> float:
    """Return the angle from which a handle counts as turned [rad]; 0 if unlatched."""
    return _TURN * door.travel if door.latch != "none" else 0.0


def stage_after(
    stage: Number, reading: DoorReading, turned: Number, latched: Flag, held: Flag
) -> Number:
    """Return the furthest stage after a control period, a place in `STAGES`.

    Where nothing holds a door, it is unlatched as soon as it is grasped. `turned` is
    what `turned_angle` gives; `held`: the door has been open and held as the task asks.
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
    """Remembers the cause of a high force or a stall, by its place in `REASONS`."""

    cause: Number = 0
    age: Number = 0.0  # Time since it was the cause [s].

    def update(
        self,
        reading: DoorReading,
        joints: Sequence[Number],
        limits: Sequence[tuple[float, float]],
        stalled: Flag,
    ) -> None:
        """Take in the arm's joints [rad] and whether the door has stalled."""
        self.age = self.age + CONTROL_PERIOD
        strained = stalled | (hypot(*reading.forces) >= HEAVY_FORCE)
        if not anywhere(strained):
            return
        at_limit = False
        for position, (low, high) in zip(joints, limits, strict=True):
            at_limit = at_limit | (position <= low) | (position >= high)
        cause = where(reading.forces[0] >= HEAVY_FORCE, _TOO_HEAVY, 0)
        cause = where(at_limit, _OUT_OF_REACH, cause)
        cause = where(reading.stop_torque > 0.0, _BLOCKED, cause)
        found = strained & (cause != 0)
        self.cause = where(found, cause, self.cause)
        self.age = where(found, 0.0, self.age)

    def reason(self, failure: Number) -> Number:
        """Return why a failure happened, a place in `REASONS`.

        ``"blocked"`` (something stops the leaf), ``"out_of_reach"`` (a joint is at its
        limit) or ``"too_heavy"`` where one of these is why the door stalled or the
        handle was lost, ``"out_of_reach"`` where that is why it was never grasped; else
        the failure itself.
        """
        if not anywhere(failure != 0):
            return failure
        recent = (self.age <= _REMEMBERED) & (self.cause != 0)
        lost = failure == GRASP_LOST
        caused = recent & ((failure == STALLED) | lost)
        reached = (failure == NOT_GRASPED) & (self.cause == _OUT_OF_REACH)
        reason = where(lost, _HANDLE_LOST, failure)
        return where(caused | (recent & reached), self.cause, reason)
