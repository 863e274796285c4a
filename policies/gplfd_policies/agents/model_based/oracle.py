"""The oracle is told the door: its errors are the robot's, not a policy's."""

import math

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.control.steps import AgentStep, Observation

_DURATION = 6.0
"""Time from the closed door to `DEMONSTRATED_ANGLE` [s]."""

_TURNING = 0.8
"""Time in which a handle is turned before [s]."""

_LET_BACK = (math.radians(8.0), math.radians(25.0))
"""Opening angles between which it is let go back [rad]."""


class OracleAgent:
    """Turns the handle and follows the true arc with minimum-jerk timing, not yielding.

    The handle is let go back while the door opens, and held as is easy for the arm, see
    `gplfd_env.DoorGeometry.easy_hand_poses`.
    """

    def __init__(self) -> None:
        self._door: DoorGeometry | None = None
        self._turned = self._phase = 0.0

    def inform(self, door: DoorGeometry) -> None:
        """Take in which door comes next: privileged information."""
        self._door = door

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._turned = self._phase = 0.0

    def act(self, observation: Observation) -> AgentStep:
        """Return the next pose on the arc; nothing observed is used.

        Raises:
            ValueError: It was not told the door.
        """
        if self._door is None:
            raise ValueError(
                "the oracle must be told the door before the episode: agent.inform("
                "door), with a gplfd_env.DoorGeometry such as DoorGeometry.nominal(0.5)"
                " or env.unwrapped.door_geometry"
            )
        if self._door.travel > 0.0 and self._turned < 1.0:
            self._turned = min(1.0, self._turned + CONTROL_PERIOD / _TURNING)
        else:
            self._phase = min(1.0, self._phase + CONTROL_PERIOD / _DURATION)
        s = self._phase
        angle = _minimum_jerk(s, DEMONSTRATED_ANGLE)
        begins, ends = _LET_BACK
        kept = 1.0 - _minimum_jerk((angle - begins) / (ends - begins))
        turn = self._door.travel * _minimum_jerk(self._turned) * kept
        pose = self._door.easy_hand_poses(angle, turn)
        return AgentStep(action=pose, desired=pose, phase=s, observed_phase=s)


def _minimum_jerk(progress: float, whole: float = 1.0) -> float:
    s = min(max(progress, 0.0), 1.0)
    return whole * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
