"""The task: criteria of success and failure, and the rewards.

Pure functions and one small state machine, independent of the simulator. Numbers are
for one simulation, or arrays (n,).
"""

import math
from dataclasses import dataclass
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD, SUCCESS_ANGLE
from gplfd_env.conventions.one_and_many import Flag, Number, magnitude, negated, where

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


def reward_terms(
    angle_gain: Number, force_radial: Number, success: Flag
) -> dict[str, Number]:
    """Return the terms whose sum is the reward of one control step.

    ``progress`` sums to 1 over an opening to `SUCCESS_ANGLE`; ``radial_force`` costs
    0.01 per second at 10 N; ``success`` is 1 once.
    """
    return {
        "progress": angle_gain / SUCCESS_ANGLE,
        "radial_force": -1e-5 * magnitude(force_radial),
        "success": 1.0 * success,
    }


def sparse_reward_terms(
    angle_gain: Number, force_radial: Number, success: Flag
) -> dict[str, Number]:
    """Return the term of the sparse reward: ``success`` is 1 once, else 0."""
    return {"success": 1.0 * success}
