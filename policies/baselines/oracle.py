"""The oracle knows the radius: its errors are the robot's, not a policy's."""

from gplfd_env.task import CONTROL_PERIOD, DEMONSTRATED_ANGLE, handle_pose_on_arc
from policies.steps import AgentStep, Observation
from policies.trajectory import GaussianTrajectory


class OracleAgent:
    """Commands the handle's true arc with minimum-jerk timing, without compliance.

    Args:
        radius: The door's true radius [m]: privileged information.
        duration: Time to the final angle [s].
        final_angle: Where the opening ends [rad].
        control_period: Time between two commands [s].
    """

    def __init__(
        self,
        radius: float,
        *,
        duration: float = 6.0,
        final_angle: float = DEMONSTRATED_ANGLE,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        self._radius = radius
        self._final_angle = final_angle
        self._step = control_period / duration
        self._phase = 0.0

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._phase = 0.0

    def act(self, observation: Observation) -> AgentStep:
        """Return the next pose on the arc; nothing observed is used."""
        self._phase = min(1.0, self._phase + self._step)
        s = self._phase
        angle = self._final_angle * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        pose = handle_pose_on_arc(self._radius, angle)
        return AgentStep(action=pose, desired=pose, phase=s, observed_phase=s)

    def forecast(self) -> GaussianTrajectory | None:
        """The oracle knows; it does not forecast."""
        return None
