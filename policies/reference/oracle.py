"""The oracle is told the door: its errors are the robot's, not a policy's."""

from gplfd_env.geometry import DoorGeometry
from gplfd_env.task import CONTROL_PERIOD, DEMONSTRATED_ANGLE
from policies.steps import AgentStep, Observation

_DURATION = 6.0
"""Time from the closed door to `DEMONSTRATED_ANGLE` [s]."""


class OracleAgent:
    """Commands the hand's true arc with minimum-jerk timing, without compliance."""

    def __init__(self) -> None:
        self._door: DoorGeometry | None = None
        self._phase = 0.0

    def inform(self, door: DoorGeometry) -> None:
        """Take in which door comes next: privileged information."""
        self._door = door

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._phase = 0.0

    def act(self, observation: Observation) -> AgentStep:
        """Return the next pose on the arc; nothing observed is used.

        Raises:
            ValueError: It was not told the door.
        """
        if self._door is None:
            raise ValueError(
                "the oracle must be told the door before the episode: agent.inform("
                "door), with a gplfd_env.DoorGeometry such as DoorGeometry.nominal(0.5)"
                " or gplfd_env.placement.door_geometry(env.unwrapped.variation)"
            )
        self._phase = min(1.0, self._phase + CONTROL_PERIOD / _DURATION)
        s = self._phase
        angle = DEMONSTRATED_ANGLE * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        pose = self._door.hand_poses(angle)
        return AgentStep(action=pose, desired=pose, phase=s, observed_phase=s)
