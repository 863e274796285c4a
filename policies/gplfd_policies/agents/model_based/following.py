"""Agents that find the path during the motion, a circle fit, and their compliance.

The simplest pull back, or in the direction of the last displacement: the last few
centimetres of a handle's path are nearly tangent to its circle.

The admittance is that of the learned agents, Eq. (22) of Arduengo et al.,
arXiv:2002.09979, M ë + D ė + K e = F, but with a very soft spring: with D² ≫ 4 M K the
displacement follows ė = F/D for some twenty seconds. It integrates the force, so that a
lasting lateral force becomes zero instead of being balanced.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.arrays.shapes import Float, SixAxes
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.steps import AgentStep, Observation, measured
from gplfd_policies.control.stiffness import VirtualDynamics

Points = Float[np.ndarray, "N 3"]
CircleParameters = Float[np.ndarray, " 4"]

_LOWEST: Final = np.array([-0.5, -0.5, -0.5, 0.2])
_HIGHEST: Final = np.array([0.5, 0.5, 0.5, 10.0])
"""Bounds of (ω, κ) [rad, 1/m]; a radius of five metres represents a straight line."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CirclePrior:
    """Prior of the circle before the hand moves: means and standard deviations."""

    axes: Float[np.ndarray, "3 3"]
    """E₀."""
    radius: float = 0.5
    """1/κ₀ [m]."""
    curvature_std: float = 1.0
    """σ_κ [1/m]: radii from a third of a metre to one metre lie within one σ_κ."""
    heading_std: float = 0.05
    """Standard deviation of the heading ω_a [rad]."""
    tilt_std: float = 0.01
    """Standard deviation of the tilt of the hinge axis, ω_t and ω_n [rad]."""
    noise: float = 1e-3
    """σ: standard deviation of a point of the path [m]."""
    far: float = 3.0
    """c: residual, in standard deviations, with half of the weight. Tuned."""

    @property
    def mean(self) -> CircleParameters:
        """Prior mean of (ω, κ)."""
        return np.array([0.0, 0.0, 0.0, 1.0 / self.radius])

    @property
    def information(self) -> CircleParameters:
        """Inverse prior variances of (ω, κ)."""
        tilt, heading = self.tilt_std**-2.0, self.heading_std**-2.0
        return np.array([tilt, heading, tilt, self.curvature_std**-2.0])


UPRIGHT: Final = CirclePrior(axes=np.eye(3))
"""Prior for an upright door in front of the robot, in the task frame."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Circle:
    """An estimate of the circle on which the hand moves about a hinge.

    The hand starts at the origin. In axes E = [t, a, n] (columns: pulling direction,
    hinge axis, and direction away from the hinge) a point p of its path has coordinates
    q = Eᵀ p. It lies on the circle of curvature κ about the hinge -n/κ if

        radial:  r = (|u| - 1)/κ = 0,  u = (κ q_t, κ q_n + 1),
        across:  q_a = 0.

    These distances [m] are not shrunk by noise, and a straight line is the regular case
    κ = 0: r = (κ(q_t² + q_n²) + 2 q_n)/(|u| + 1). With E = E₀ exp(ω), the estimate is

        min over ω, κ:  Σ_i ρ(‖(r_i, q_a,i)‖/σ) + Σ_j (ω_j/σ_j)² + ((κ - κ₀)/σ_κ)²,

    with ρ(e) = c² log(1 + e²/c²), by Gauss-Newton with weights 1/(1 + e²/c²), one step
    for every new point. N. Chernov, *Circular and Linear Regression*, 2010, ch. 4-6;
    P. J. Huber, *Robust Statistics*, 1981.
    """

    prior: CirclePrior
    """The prior of this estimate."""
    parameters: CircleParameters
    """(ω, κ) [rad, 1/m]."""

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """E."""
        return np.asarray(self.prior.axes @ _rotation(*self.parameters[:3].tolist()))

    @property
    def curvature(self) -> float:
        """κ [1/m]."""
        return float(self.parameters[3])

    def door(self) -> DoorGeometry:
        """Return the door whose handle moves on this circle."""
        axes = self.axes
        return DoorGeometry(hinge=-axes[:, 2] / self.curvature, axis=axes[:, 1])

    def updated(self, points: Points) -> Circle:
        """Return the estimate after a Gauss-Newton step from this one."""
        prior, information = self.prior, self.prior.information
        distances, slopes = _distances((points @ self.axes).T, self.curvature)
        squares = np.add.reduce(distances**2, axis=0) / prior.noise**2
        weights = 1.0 / (prior.noise**2 * (1.0 + squares / prior.far**2))
        weighted, flat = (weights * slopes).reshape(4, -1), slopes.reshape(4, -1)
        gradient = information * (self.parameters - prior.mean)
        gradient += weighted @ distances.ravel()
        step = np.linalg.solve(np.diag(information) + weighted @ flat.T, gradient)
        # Rotations are small: the rotation of a step may be added.
        parameters = self.parameters - step
        bounded = np.minimum(np.maximum(parameters, _LOWEST), _HIGHEST)
        return Circle(prior=prior, parameters=bounded)


def _distances(
    points: Float[np.ndarray, "3 N"], kappa: float
) -> tuple[Float[np.ndarray, "2 N"], Float[np.ndarray, "4 2 N"]]:
    """Return r and q_a of points (q_t, q_a, q_n), and their derivatives.

    They are by a small rotation δ, E exp(δ), which moves q by -δ × q, and by κ.
    """
    t, a, n = points
    square, across = t * t + n * n, kappa * n + 1.0
    # At the hinge itself, the direction away from it is not defined.
    length = np.maximum(np.hypot(kappa * t, across), 1e-9)
    radial = (kappa * square + 2.0 * n) / (length + 1.0)
    by_t, by_n = kappa * t / length, across / length
    by_length = (kappa * t * t + n * across) / length
    slopes = np.zeros((4, 2, t.size))
    slopes[0] = -by_n * a, n
    slopes[1, 0] = by_n * t - by_t * n
    slopes[2] = by_t * a, -t
    slopes[3, 0] = (square - radial * by_length) / (length + 1.0)
    return np.stack([radial, a]), slopes


def _rotation(x: float, y: float, z: float) -> Float[np.ndarray, "3 3"]:
    """Return exp of a rotation vector; SciPy's takes as long as the rest of a step."""
    angle = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    bend = (math.sin(angle / 2.0) / (angle / 2.0)) ** 2 / 2.0
    rotation = np.eye(3) + math.sin(angle) / angle * cross + bend * (cross @ cross)
    return np.asarray(rotation)


Point = Float[np.ndarray, " 3"]

_PULL: Final = np.array([1.0, 0.0, 0.0])
"""Pulling direction of a closed door, task frame."""
_SPACING: Final = 0.005
"""Length of a segment of the path [m]: several times the noise of a position. Tuned."""
_CHORD: Final = 12  # number of segments that the last displacement spans. Tuned
_STIFFNESS: Final = np.repeat([5.0, 0.5], 3)
"""K, translation [N/m] and rotation [N m/rad]. Tuned."""
_NEARLY_FREE: Final = VirtualDynamics(mass=np.repeat([1.0, 0.1], 3), damping_ratio=22.4)
"""M, and δ, with which D = 2 δ √(M K) is 100 N s/m and 10 N m s/rad. Tuned."""
JUMP_DECAY: Final = 0.95
"""Share of a jump between two estimates of the path left after a period. Tuned."""
CARRIED: Final = CarriedLoad()  # Load rule of these agents; it has no state.


class HandPath:
    """Mean points, or poses, of the segments of the hand's path [m, rad]."""

    points: Float[np.ndarray, "N size"]

    def __init__(self, size: int = 3) -> None:
        self.points, self._last = np.zeros((0, size)), np.zeros(3)
        self._sum, self._count = np.zeros(size), 0

    def add(self, point: Float[np.ndarray, " size"]) -> bool:
        """Add a point of the hand; return whether it ends a segment."""
        self._sum += point
        self._count += 1
        if math.dist(point[:3], self._last) < _SPACING:
            return False
        self._last = point[:3].copy()
        self.points = np.vstack([self.points, self._sum / self._count])
        self._sum, self._count = np.zeros_like(self._sum), 0
        return True

    def direction(self) -> Point:
        """Return the direction of the last displacement; at first the pull."""
        missing = _CHORD - len(self.points)
        if missing == _CHORD:
            return _PULL
        start = -missing * _SPACING * _PULL
        if missing <= 0:
            start = self.points[-_CHORD]
        chord = self.points[-1] - start
        return np.asarray(chord / np.sqrt(chord @ chord))


def accelerated(speed: float, left: float, rate: float, most: float) -> float:
    """Return the next speed, at most ``most``, that can still stop within ``left``."""
    return min(speed + rate * CONTROL_PERIOD, math.sqrt(2.0 * rate * left), most)


def turned_towards(direction: Point) -> Point:
    """Return the shortest rotation vector from the pull to a unit vector."""
    _, up, left = direction
    across = np.array([0.0, -left, up])
    sine = math.hypot(up, left)
    scale = math.atan2(sine, direction[0]) / sine if sine > 1e-9 else 1.0
    return np.asarray(scale * across)


class CompliantSetPoint:
    """Set-points that forces displace; initially at rest and not displaced."""

    def __init__(self) -> None:
        self._admittance = Admittance(_NEARLY_FREE)

    def step(self, desired: SixAxes, wrench: SixAxes, **fields: Any) -> AgentStep:
        """Return the step that commands a pose, displaced by a wrench."""
        offset = self._admittance.step(_STIFFNESS, wrench, CONTROL_PERIOD)
        action = desired + offset
        action[3:] = compose_rotvecs(offset[3:], desired[3:])
        return AgentStep(action=action, desired=desired, stiffness=_STIFFNESS, **fields)


class StartedAgent(ABC):
    """An agent that begins at the closed door when it is made, as after a reset."""

    def __init__(self) -> None:
        self.reset({})

    @abstractmethod
    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""


_PULL_WRENCH: Final = np.array([16.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Constant wrench that pulls the set-point away from the door [N, N m]. Tuned."""
_LEAD: Final = 0.015
"""Distance of the set-point ahead of the hand [m]: 30 N of the robot's servo."""
_LEAD_RATE: Final = 0.015  # rate at which the lead grows at first [m/s]. Tuned
_SPEED: Final = 0.12
"""Speed of the set-point that moves in the last direction [m/s]. Tuned."""


class CompliantPullAgent(StartedAgent):
    """Pulls straight back with a constant force and yields to everything else."""

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._set_point = CompliantSetPoint()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        _, wrench = measured(observation)
        return self._set_point.step(np.zeros(6), wrench + _PULL_WRENCH)


class ChordAgent(StartedAgent):
    """Commands a point ahead of the hand, in the direction of its last displacement."""

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path = HandPath()
        self._lead, self._action = 0.0, np.zeros(6)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand = measured(observation)[0][:3]
        self._path.add(hand)
        direction = self._path.direction()
        turn = turned_towards(direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            farther = self._lead + _LEAD_RATE * CONTROL_PERIOD
            self._lead = min(farther, _LEAD)
            self._action = np.concatenate([hand + self._lead * direction, turn])
        return AgentStep(action=self._action)


class ReflexAgent(StartedAgent):
    """Moves in the direction of the last displacement; yields to forces across it."""

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path, self._set_point = HandPath(), CompliantSetPoint()
        self._position = np.zeros(3)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        self._path.add(hand[:3])
        direction = self._path.direction()
        turn = turned_towards(direction)
        load = CARRIED.compensate(wrench, direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            self._position += _SPEED * CONTROL_PERIOD * load.pace * direction
        desired = np.concatenate([self._position, turn])
        return self._set_point.step(desired, load.compliant_wrench)


_ANGULAR_SPEED: Final = 0.25  # angular speed of the opening [rad/s]. Tuned
_ANGULAR_ACCELERATION: Final = 0.125
"""Angular acceleration and deceleration [rad/s²]. Tuned."""


class HingeFitAgent(StartedAgent):
    """Finds the hinge while it opens the door, and follows the circle about it.

    The hand moves along the circle estimated from its path so far and turns with the
    angle. It yields to every force except the door's resistance along the path.
    """

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed door."""
        self._path, self._set_point = HandPath(), CompliantSetPoint()
        self._circle = Circle(prior=UPRIGHT, parameters=UPRIGHT.mean)
        self._door = self._circle.door()
        # A length, not an angle: a change of radius moves the set-point only sideways.
        self._travelled = self._speed = 0.0
        self._fading = np.zeros(6)
        self.observed_angle = 0.0

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        if self._path.add(hand[:3]):
            # A new estimate: the command changes to it without a jump.
            before = self._door.hand_poses(self._angle)
            self._circle = self._circle.updated(self._path.points)
            self._door = self._circle.door()
            self._fading += before - self._door.hand_poses(self._angle)

        # The set-point advances; it stops at the angle at which demonstrations end.
        direction = self._door.direction(self._angle)
        load = CARRIED.compensate(wrench, direction)
        left = max(DEMONSTRATED_ANGLE - self._angle, 0.0)
        self._speed = accelerated(
            self._speed, left, _ANGULAR_ACCELERATION, _ANGULAR_SPEED
        )
        step = float(load.pace) * self._speed * CONTROL_PERIOD * self._door.radius
        self._travelled = max(self._travelled + step, 0.0)

        self._fading *= JUMP_DECAY
        observed = self.observed_angle = float(self._door.angle(hand[:3]))
        return self._set_point.step(
            self._door.hand_poses(self._angle) + self._fading,
            load.compliant_wrench,
            phase=self._angle / DEMONSTRATED_ANGLE,
            observed_phase=min(max(observed / DEMONSTRATED_ANGLE, 0.0), 1.0),
        )

    @property
    def _angle(self) -> float:
        """Angle of the set-point on the current circle [rad]."""
        return self._travelled / self._door.radius
