"""The task: criteria of success and failure, stages, diagnosis, and the rewards.

Pure functions and two small state machines, independent of the simulator. The stages
follow the EUROBENCH benchmark for robots that open doors: grasp, turn the handle,
unlatch, open, release, close. Numbers are for one simulation, or arrays (n,).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from gplfd_env.conventions.constants import CONTROL_PERIOD, SUCCESS_ANGLE
from gplfd_env.conventions.one_and_many import (
    Flag,
    Number,
    anywhere,
    hypot,
    larger,
    magnitude,
    negated,
    where,
)
from gplfd_env.doors.config import DoorConfig

if TYPE_CHECKING:  # Policies need the criteria without MuJoCo.
    from gplfd_env.task.observation import DoorReading

Terms = dict[str, Number]  # Terms of a reward, by name.

DEMONSTRATED_ANGLE: Final = math.radians(67.0)
"""Opening angle at which demonstrations end [rad]: a little beyond `SUCCESS_ANGLE`, so
that an agent that follows one with some lag still succeeds."""
HOLD_TIME: Final = 0.5
"""Time for which the angle must be held while the hand holds the handle [s]."""
GRASP_LOST_TIME: Final = 0.25
"""The handle counts as lost after this time without contact of both pads [s]."""
TRIED_ANGLE: Final = math.radians(5.0)
"""If the handle's position is uncertain, a handle that slips from the fingers at an
opening angle below this does not count as lost: the robot may grasp it again [rad]."""

STALL_ANGLE: Final = math.radians(0.5)
STALL_TIME: Final = 3.0
"""A door that gains less than `STALL_ANGLE` [rad] in this time [s] has stalled."""
STALL_TURN: Final = math.radians(5.0)
"""A door has not stalled if its handle turns further by this [rad] in the same time."""

_OTHERS: Final = ("stalled", "latched", "simulation_error", "not_grasped")
FAILURES: Final = ("", "grasp_lost", "base_blocked", *_OTHERS)
"""Kinds of failure, by number."""

GRASP_LOST, BASE_BLOCKED, STALLED, LATCHED, SIMULATION_ERROR, NOT_GRASPED = range(1, 7)

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


@dataclass(slots=True)
class OpeningMonitor:
    """Decides in each step whether the door is open, lost or stalled.

    A failure is an index into `FAILURES`: ``"grasp_lost"`` is final, the others are
    reset when their cause ends. A stalled door that the latch still holds is
    ``"latched"``.
    """

    taken: Flag = True  # The hand has grasped the handle and not released it.
    success: Flag = False  # The success angle has been held, handle in hand.
    failure: Number = 0
    held: Number = 0.0  # Time for which that angle has been held so far [s].
    released: Number = 0.0  # Time since the fingers lost the handle [s].
    best_angle: Number = -math.inf  # Opening angle at the last gain [rad].
    best_turn: Number = -math.inf  # Handle angle at the last gain [rad].
    since_gain: Number = 0.0  # Time since the last gain [s].

    def update(
        self,
        angle: Number,
        grasped: Flag,
        turn: Number = 0.0,
        *,
        latched: Flag = False,
        blocked: Flag = False,
        opened: Flag = False,
    ) -> Flag:
        """Update the state; return whether the hand took hold.

        `turn` is the angle of the handle [rad]; `opened`: the gripper is wider than it.
        """
        took = grasped & negated(self.taken)
        # A handle that is released on purpose is not lost.
        self.taken = grasped | (self.taken & negated(opened))
        is_open = grasped & (angle >= SUCCESS_ANGLE)
        self.held = where(is_open, self.held + CONTROL_PERIOD, 0.0)
        self.success = self.success | (self.held >= HOLD_TIME - 1e-9)
        lacking = self.taken & negated(grasped)
        self.released = where(lacking, self.released + CONTROL_PERIOD, 0.0)
        moved = angle >= self.best_angle + STALL_ANGLE
        turned = turn >= self.best_turn + STALL_TURN
        self.best_angle = where(moved, angle, self.best_angle)
        self.best_turn = where(turned, turn, self.best_turn)
        gained = moved | turned | took
        self.since_gain = where(gained, 0.0, self.since_gain + CONTROL_PERIOD)

        stuck = self.since_gain >= STALL_TIME - 1e-9
        lost = (self.failure == GRASP_LOST) | (self.released >= GRASP_LOST_TIME - 1e-9)
        failed = (stuck | lost | blocked) & negated(self.success)
        if failed is False:
            self.failure = 0
            return took
        failure = where(self.taken, where(latched, LATCHED, STALLED), NOT_GRASPED)
        failure = where(blocked, BASE_BLOCKED, failure)
        failure = where(lost, GRASP_LOST, failure)
        self.failure = where(failed, failure, 0)
        return took


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


def reward_terms(angle_gain: Number, radial: Number, success: Flag) -> Terms:
    """Return the terms whose sum is the reward of one control step.

    ``progress`` sums to 1 over an opening to `SUCCESS_ANGLE`; ``radial_force`` costs
    0.01 per second at 10 N; ``success`` is 1 once.
    """
    return {
        "progress": angle_gain / SUCCESS_ANGLE,
        "radial_force": -1e-5 * magnitude(radial),
        "success": 1.0 * success,
    }


def sparse_reward_terms(angle_gain: Number, radial: Number, success: Flag) -> Terms:
    """Return the term of the sparse reward: ``success`` is 1 once, else 0."""
    return {"success": 1.0 * success}
