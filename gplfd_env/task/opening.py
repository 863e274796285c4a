"""The task: the handle's arc, what counts as opened, what counts as failed, reward.

Pure functions and one small state machine; nothing here knows the simulator. Numbers
are of one simulation, or arrays (n,).
"""

import math
from dataclasses import dataclass
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD, SUCCESS_ANGLE
from gplfd_env.conventions.one_and_many import Flag, Number, negated, where

DEMONSTRATED_ANGLE: Final = math.radians(67.0)
"""Opening angle at which demonstrations end [rad]: a little beyond `SUCCESS_ANGLE`, so
that who follows one with some lag still succeeds."""

HOLD_TIME: Final = 0.5
"""How long the angle must be held, handle in hand [s]."""

GRASP_LOST_TIME: Final = 0.25
"""The handle counts as lost after this long without both pads on it [s]."""

TRIED_ANGLE: Final = math.radians(5.0)
"""Where the robot does not know exactly where the handle is, a handle that slips from
its fingers at a smaller angle than this is not lost: it may take hold again [rad]."""

STALL_ANGLE: Final = math.radians(0.5)
STALL_TIME: Final = 3.0
"""A door that gains less than `STALL_ANGLE` [rad] in this time [s] has stalled."""

STALL_TURN: Final = math.radians(5.0)
"""But not while its handle is turned on by this [rad] in the same time."""

FAILURES: Final = (
    *("", "grasp_lost", "base_blocked", "stalled", "latched", "simulation_error"),
    "not_grasped",
)
"""What can go wrong, by number."""

GRASP_LOST, BASE_BLOCKED, STALLED, LATCHED, SIMULATION_ERROR, NOT_GRASPED = range(1, 7)


@dataclass(slots=True)
class OpeningMonitor:
    """Decides, step by step, whether the door is opened, lost or stuck.

    A failure is a place in `FAILURES`: ``"grasp_lost"`` is final, the others hold while
    they last; a door that its latch still holds is ``"latched"`` rather than
    ``"stalled"``.
    """

    taken: Flag = True  # The hand has taken hold of the handle and not let it go.
    success: Flag = False  # The success angle has been held, handle in hand.
    failure: Number = 0
    held: Number = 0.0  # For how long that angle has been held so far [s].
    released: Number = 0.0  # For how long the fingers have lost the handle [s].
    best_angle: Number = -math.inf  # Of the last gain [rad].
    best_turn: Number = -math.inf  # Of the handle at the last gain [rad].
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
        """Take in the state after one control step; return where the hand took hold.

        `turn` is that of the handle [rad]; `opened` means that the gripper is told to
        be wider than the handle.
        """
        took = grasped & negated(self.taken)
        # A handle that is let go of on purpose is not lost.
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
        "radial_force": -1e-5 * abs(force_radial),
        "success": 1.0 * success,
    }


def sparse_reward_terms(
    angle_gain: Number, force_radial: Number, success: Flag
) -> dict[str, Number]:
    """Return the term of the sparse reward: ``success`` is 1 once, else 0."""
    return {"success": 1.0 * success}
