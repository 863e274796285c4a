"""The task: the handle's arc, what counts as opened, what counts as failed, reward.

Pure functions and one small state machine; nothing here knows the simulator.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUCCESS_ANGLE: Final = math.radians(60.0)
"""Opening angle of a success [rad]."""

DEMONSTRATED_ANGLE: Final = math.radians(67.0)
"""Opening angle at which demonstrations end [rad]: a little beyond `SUCCESS_ANGLE`, so
that who follows one with some lag still succeeds."""

HOLD_TIME: Final = 0.5
"""How long the angle must be held, handle in hand [s]."""

GRASP_LOST_TIME: Final = 0.25
"""The handle counts as lost after this long without both pads on it [s]."""

STALL_ANGLE: Final = math.radians(0.5)
STALL_TIME: Final = 3.0
"""A door that gains less than `STALL_ANGLE` [rad] in this time [s] has stalled."""

STALL_TURN: Final = math.radians(5.0)
"""But not while its handle is turned on by this [rad] in the same time."""


@dataclass(slots=True)
class OpeningMonitor:
    """Decides, step by step, whether the door is opened, lost or stuck.

    Attributes:
        dt: Control period [s].
        success: The success angle has been held for `HOLD_TIME` with the handle
            grasped.
        failure: ``""``, ``"grasp_lost"`` (final), and while they last
            ``"base_blocked"``, ``"not_grasped"``, ``"stalled"`` or, where the latch
            still holds the door, ``"latched"``.
        taken: The hand has taken hold of the handle and not let it go.
    """

    dt: float
    taken: bool = True
    success: bool = False
    failure: str = ""
    _held: float = 0.0
    _released: float = 0.0
    _best_angle: float = -math.inf
    _best_turn: float = -math.inf
    _since_gain: float = 0.0

    def update(
        self,
        angle: float,
        grasped: bool,
        turn: float = 0.0,
        *,
        latched: bool = False,
        blocked: bool = False,
        opened: bool = False,
    ) -> None:
        """Take in the state after one control step.

        Args:
            angle: Opening angle [rad].
            grasped: Both fingers touch the handle.
            turn: How far the handle is turned [rad].
            latched: The bolt holds the door.
            blocked: Something holds the base.
            opened: The gripper is told to be wider than the handle.
        """
        took = grasped and not self.taken
        # A handle that is let go of on purpose is not lost.
        self.taken = grasped or (self.taken and not opened)
        self._held = self._held + self.dt if self._is_open(angle, grasped) else 0.0
        self.success = self.success or self._held >= HOLD_TIME - 1e-9
        lacking = self.taken and not grasped
        self._released = self._released + self.dt if lacking else 0.0
        moved = angle >= self._best_angle + STALL_ANGLE
        turned = turn >= self._best_turn + STALL_TURN
        self._best_angle = angle if moved else self._best_angle
        self._best_turn = turn if turned else self._best_turn
        gained = moved or turned or took
        self._since_gain = 0.0 if gained else self._since_gain + self.dt
        self.failure = self._diagnose(latched, blocked)

    @staticmethod
    def _is_open(angle: float, grasped: bool) -> bool:
        return grasped and angle >= SUCCESS_ANGLE

    def _diagnose(self, latched: bool, blocked: bool) -> str:
        if self.success:
            return ""
        if self.failure == "grasp_lost" or self._released >= GRASP_LOST_TIME - 1e-9:
            return "grasp_lost"
        if blocked:
            return "base_blocked"
        if self._since_gain < STALL_TIME - 1e-9:
            return ""
        if not self.taken:
            return "not_grasped"
        return "latched" if latched else "stalled"


def reward_terms(
    angle_gain: float, force_radial: float, success: bool
) -> dict[str, float]:
    """Return the terms whose sum is the reward of one control step.

    Args:
        angle_gain: Change of the opening angle in this step [rad].
        force_radial: Radial force between hand and handle [N]: wasted effort.
        success: The episode has just ended in success.

    Returns:
        ``progress`` sums to 1 over an opening to `SUCCESS_ANGLE`; ``radial_force``
        costs 0.01 per second at 10 N; ``success`` is 1 once.
    """
    return {
        "progress": angle_gain / SUCCESS_ANGLE,
        "radial_force": -1e-5 * abs(force_radial),
        "success": float(success),
    }


def sparse_reward_terms(
    angle_gain: float, force_radial: float, success: bool
) -> dict[str, float]:
    """Return the term of the sparse reward: ``success`` is 1 once, else 0.

    The arguments are those of `reward_terms`.
    """
    return {"success": float(success)}
