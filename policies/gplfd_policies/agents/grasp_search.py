"""Grasping a handle of uncertain pose: correct by contact, test the grasp, repeat.

The search uses only the hand's pose and the wrench on it, like every agent. It needs
neither the width of the fingers nor finger contacts.
"""

import math
from typing import Final, Literal

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH
from gplfd_policies.arrays.shapes import Float, Pose
from gplfd_policies.control.steps import Observation

Vector = Float[np.ndarray, " 3"]
Phases = Float[np.ndarray, " N"]
Waves = Float[np.ndarray, "2 ..."]
Stage = Literal["reach", "back", "in", "close", "shake", "held"]

CLOSING: Final = 0.9
"""Time that the gripper needs to close with full force [s]; the hand waits at the
handle meanwhile."""

ATTEMPTS: Final = 3
"""Greatest number of grasps. More would leave no time to open the door."""

CONTACT_FORCE: Final = 8.0
"""Force on the hand that stops a motion [N]: several times the noise of the sensor."""

DAMPING: Final = 400.0
"""D: damping with which the hand yields to forces while the gripper closes [N s/m].
With the servo's 2000 N/m the bandwidth of the loop is 5 rad/s."""

SHAKE: Final = (0.006, 0.6)
"""Amplitude [m] and duration [s] of the test of a grasp."""

RESISTANCE: Final = 1.5
"""Least amplitude of the force that resists the shake if the hand holds something [N].
With the servo's 2000 N/m a rigid handle resists with 12 N, a lever's spring with 2 to
9 N; an empty hand has no resistance, and noise of 1 N contributes 0.2 N."""

_REST: Final = 0.15
"""Time for which the hand rests after the shake [s]."""
_SETTLED: Final = 0.2
"""Forces count as contact only after this time since the beginning of a motion [s]."""
_ARRIVED: Final = 0.005
"""A force nearer than this to the goal is caused by the closing fingers [m]."""
_FINGER: Final = 0.05
"""Distance of an open finger from the middle, and thus the greatest of a contact
[m]."""
_BEFORE: Final = np.array([0.12, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Turning point of the hand relative to the goal [m, rad]: far enough for the fingers
to pass the handle."""
_BACK_TIME: Final = 0.9
_IN_TIME: Final = 1.1
_DEEPER: Final = (-1.5, -1.0)
"""Additional depth of the next grasps, in standard deviations: without a contact the
handle can only be beyond the finger tips."""


class GraspSearch:
    """Commands of one episode, from the standoff until the hand holds the handle.

    1. *Reach*: as learned. A contact stops the motion. Its point r in the hand, of
       which F × (r × F)/F² is known, shows where the handle is.
    2. *Close*: while the gripper closes, the hand follows the force, ė = F/D, and
       centres itself on the handle.
    3. *Shake*: a motion upwards and to the side. Its resistance is the amplitude of the
       opposing force. If the hand holds something, there is resistance on both axes.
    4. If not, *back* and *in*: straight to the next place.

    Args:
        spread: Standard deviation of the handle's believed position [m].
        duration: Duration of the first reach [s].

    Attributes:
        stage: Current stage; ``"held"`` also after the last failed attempt.
        attempt: Number of the present grasp, from 1.
    """

    def __init__(self, spread: float, duration: float) -> None:
        self._spread, self._duration = spread, duration
        self.stage: Stage = "reach"
        self.attempt, self._since = 1, 0.0
        self._goal, self._from, self._command = np.zeros((3, 6))
        self._forces: list[Vector] = []

    @property
    def gripper_width(self) -> float:
        """Commanded width of the gripper [m]: open during motions, else closed."""
        return GRIPPER_WIDTH if self.stage in ("reach", "back", "in") else 0.0

    def command(self, observation: Observation, reached: Pose) -> Pose:
        """Return the next commanded pose, given the pose of the learned reach."""
        force, torque = np.split(np.asarray(observation["wrench"]), 2)
        self._since += CONTROL_PERIOD
        since, goal = self._since, self._goal
        match self.stage:
            case "reach":
                self._command = reached
                self._go_on(since >= self._duration, "close")
            case "back":
                self._command = self._toward(goal + _BEFORE, since / _BACK_TIME)
                self._go_on(since >= _BACK_TIME, "in")
            case "in":
                self._command = self._toward(goal, since / _IN_TIME)
                self._go_on(since >= _IN_TIME, "close")
            case "close":
                self._command[:3] += force / DAMPING * CONTROL_PERIOD
                self._go_on(since >= CLOSING, "shake")
            case "shake":
                self._command = self._from.copy()
                if since <= SHAKE[1]:
                    self._forces.append(force)
                    self._command[1:3] += SHAKE[0] * _shake(since / SHAKE[1])
                elif since >= SHAKE[1] + _REST:
                    self._judge(observation)
        squared = float(force @ force)
        moving = self.stage in ("reach", "in") and since > _SETTLED
        if moving and squared > CONTACT_FORCE**2:
            if math.dist(self._command[:3], goal[:3]) > _ARRIVED:
                beside = np.cross(force, torque) / squared
                beside *= min(1.0, _FINGER / math.sqrt(beside @ beside))
                self._again(observation, np.array([0.0, *beside[1:]]))
            else:
                self._go_on(True, "close")
        return self._command.copy()

    def _judge(self, observation: Observation) -> None:
        """Decide by the forces of the shake whether the hand holds something."""
        shares = np.arange(1, len(self._forces) + 1) / len(self._forces)
        forces, waves = np.array(self._forces)[:, 1:], _shake(shares)
        resistance = -2.0 * (forces * waves.T).mean(axis=0)
        self._go_on(bool(resistance.min() >= RESISTANCE), "held")
        if self.stage != "held":
            deeper = self._spread * _DEEPER[min(self.attempt, len(_DEEPER)) - 1]
            self._again(observation, np.array([deeper, 0.0, 0.0]))

    def _again(self, observation: Observation, beside: Vector) -> None:
        """Start the next grasp, displaced from this one, unless it was the last."""
        self._command = np.array(observation["ee_pose"])
        if self.attempt < ATTEMPTS:
            self.attempt += 1
            self._goal[:3] += beside
            self._go_on(True, "back")
        else:
            self._go_on(True, "held")

    def _go_on(self, done: bool, stage: Stage) -> None:
        """Begin the next stage once the present one is done."""
        if done:
            self.stage, self._since = stage, 0.0
            self._from, self._forces = self._command.copy(), []

    def _toward(self, goal: Pose, share: float) -> Pose:
        """Return the pose of a minimum-jerk motion at a share of its time."""
        s = min(share, 1.0)
        progress = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        return np.asarray(self._from + progress * (goal - self._from))


def _shake(share: float | Phases) -> Waves:
    """Return the motion upwards and to the left, of amplitude 1, uncorrelated."""
    angle = 2.0 * math.pi * np.asarray(share)
    return np.array([np.sin(2.0 * angle), np.sin(angle)])
