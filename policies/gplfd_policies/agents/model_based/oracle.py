"""Agents with privileged information: the door, or the motion of its handle."""

import math
from dataclasses import replace
from typing import Final

import numpy as np
import scipy

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.following import HingeFitAgent
from gplfd_policies.arrays.shapes import Pose
from gplfd_policies.control.steps import AgentStep, Observation, measured

_KNOB: Final = 0.03
_SHORT: Final = 0.065
"""Distance of the hand from the handle's axis [m]: at most `_KNOB` for a knob, at least
`_SHORT` for a lever, whose servo error is small relative to its motion."""
_FIRMLY: Final = 0.01  # distance of the command beyond the stop: 20 N of the servo [m]
_LET_BACK: Final = math.radians(8.0), math.radians(25.0)
"""Opening angles between which the handle turns back [rad]."""
_DURATION: Final = 6.0
"""Time of the oracle from the closed door to `DEMONSTRATED_ANGLE` [s]."""


class _HandleTurner:
    """Turns a handle before the door opens, and back while the door opens."""

    _door: DoorGeometry | None = None
    _turned = 0.0
    _turning: float
    """Time in which a handle is turned [s]."""

    def inform(self, door: DoorGeometry) -> None:
        """Receive the door of the next episode."""
        self._door = door

    def _told(self) -> DoorGeometry:
        """Return the door, or raise if `inform` was not called."""
        if self._door is None:
            raise ValueError(
                f"{type(self).__name__} must be told the door before the episode: "
                "agent.inform(door), with a gplfd_env.DoorGeometry such as "
                "DoorGeometry.of(DoorConfig(radius=0.5)) or env.unwrapped.door_geometry"
            )
        return self._door

    def _turns_handle(self, door: DoorGeometry) -> bool:
        """Turn the handle for a period; return whether the turn was unfinished."""
        if door.travel > 0.0 and self._turned < 1.0:
            self._turned = min(1.0, self._turned + CONTROL_PERIOD / self._turning)
            return True
        return False

    def _travel(self, door: DoorGeometry) -> float:
        """Return the commanded turn of the handle, up to its stop [rad].

        Beyond it if the hand holds the handle near its axis, like a thumb piece: the
        servo yields to the spring by a large part of such a short motion.
        """
        if door.spindle is None or door.turn is None:
            return door.travel
        lever = np.cross(door.turn, door.spindle)
        arm = math.sqrt(lever @ lever)
        across = abs(float(lever @ door.pull)) < 0.5 * arm
        return door.travel + (_FIRMLY / arm if _KNOB < arm < _SHORT and across else 0.0)

    def _kept(self, angle: float) -> float:
        """Return the share of the turn that remains at an opening angle [rad]."""
        begins, ends = _LET_BACK
        return 1.0 - _minimum_jerk((angle - begins) / (ends - begins))


class OracleAgent(_HandleTurner):
    """Turns the handle and follows the true arc stiffly, with minimum-jerk timing."""

    _turning = 0.8
    _phase = 0.0

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._turned = self._phase = 0.0

    def act(self, observation: Observation) -> AgentStep:
        """Return the next pose on the arc; nothing observed is used."""
        door = self._told()
        if not self._turns_handle(door):
            self._phase = min(1.0, self._phase + CONTROL_PERIOD / _DURATION)
        s = self._phase
        angle = _minimum_jerk(s, DEMONSTRATED_ANGLE)
        turn = self._travel(door) * _minimum_jerk(self._turned) * self._kept(angle)
        pose = door.easy_hand_poses(angle, turn)
        return AgentStep(action=pose, desired=pose, phase=s, observed_phase=s)


class ToldHandleAgent(_HandleTurner):
    """Turns the known handle, then opens the door by a circle fit.

    While the handle is turned by θ, the motion of the leaf is observed and commanded
    through the handle's known displacement, as rigid motions: hand = leaf ∘ handle(θ).
    """

    _turning = 1.0

    def __init__(self) -> None:
        self._opener = HingeFitAgent()

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._turned = 0.0
        self._opener.reset(observation)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, _ = measured(observation)
        door = self._told()
        if self._turns_handle(door):
            turn = _minimum_jerk(self._turned) * self._travel(door)
            pose = door.hand_poses(0.0, turn)
            return AgentStep(action=pose, desired=pose, phase=0.0, observed_phase=0.0)
        # The opener observes and commands the leaf: the hand without the handle's turn.
        kept = self._kept(self._opener.observed_angle)
        handle = door.hand_poses(0.0, kept * self._travel(door))
        back = scipy.spatial.transform.Rotation.from_rotvec(-handle[3:])
        inverse = np.concatenate([-back.apply(handle[:3]), -handle[3:]])
        leaf = _composed(hand, inverse)
        step = self._opener.act({**observation, "ee_pose": leaf})
        action, desired = (_composed(p, handle) for p in (step.action, step.desired))
        return replace(step, action=action, desired=desired)


def _composed(first: Pose, second: Pose) -> Pose:
    """Return first ∘ second."""
    # Copies, because SciPy rejects read-only arrays.
    turn = scipy.spatial.transform.Rotation.from_rotvec(first[3:].copy())
    both = turn * scipy.spatial.transform.Rotation.from_rotvec(second[3:].copy())
    return np.concatenate([first[:3] + turn.apply(second[:3]), both.as_rotvec()])


def _minimum_jerk(progress: float, whole: float = 1.0) -> float:
    s = min(max(progress, 0.0), 1.0)
    return whole * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
