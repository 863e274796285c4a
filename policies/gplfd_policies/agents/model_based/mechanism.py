"""Models of a mechanism that guides a hand, model selection, and an agent.

The models are from J. Sturm, C. Stachniss and W. Burgard, *A Probabilistic Framework
for Learning Kinematic Models of Articulated Objects*, JAIR 41 (2011) 477-526. Each maps
a latent coordinate q to a pose f(q) and back, with d degrees of freedom, k parameters:

| model | d | k | q |
|---|---|---|---|
| rigid | 0 | 6 | none |
| prismatic | 1 | 8 | distance along a line |
| rotational | 1 | 9 | length of arc about an axis |
| Gaussian process | 1 | 1 + d + 6 m | length of the path; m training poses |

Δ_i is the error of the i-th of n poses relative to its projection f(q_i), γ the share
of outliers; q is uniform over the n observed places. The least BIC selects the model:

    BIC = -2 (Σ_i log p(Δ_i) - d n log n) + k log n,
    p(Δ) = (1 - γ) N(Δ; 0, Σ) + γ U.

Differences to the paper: all q are lengths [m]; every model except the rigid one begins
at the origin, the closed door; and the fits have priors.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.following import (
    CARRIED,
    JUMP_DECAY,
    UPRIGHT,
    Circle,
    CirclePrior,
    CompliantSetPoint,
    HandPath,
    StartedAgent,
    accelerated,
)
from gplfd_policies.arrays.rows import PerRow
from gplfd_policies.arrays.shapes import Axes, Float, Vectors
from gplfd_policies.control.steps import AgentStep, Observation, measured

Array = Float[np.ndarray, "..."]
Path = Float[np.ndarray, "N 6"]

_STD: Final = np.repeat([1e-3, 0.2], 3)
"""Square root of Σ [m, rad]. The grip slips, so orientation is uncertain. Tuned."""
_OUTLIERS: Final = 0.01
"""γ; U is uniform over positions in a cubic metre and all orientations."""
_EVERY, _MOST = 4, 20
"""Points of a path per training pose, tuned; and greatest m, as in the paper."""
_SLOPE, _BEND = 1e6, 2e5
"""a and b of the process, relative to the noise variance [1/m², 1/m³]. Tuned."""


class MotionModel:
    """A model of the motion of a hand; the base class is rigid: no motion."""

    degrees, parameters = 0, 6

    def __init__(self, pose: Float[np.ndarray, " 6"]) -> None:
        self._pose = pose

    def updated(self, path: Path) -> MotionModel:
        """Return the model fitted to a path, starting from this one."""
        return MotionModel(path.mean(axis=0))

    def coordinates(self, positions: Vectors) -> PerRow:
        """Return q of the poses nearest to positions [m]."""
        return np.zeros(positions.shape[:-1])

    def poses(self, coordinates: PerRow | float) -> Axes:
        """Return f(q) [m, rad]."""
        return np.broadcast_to(self._pose, (*np.shape(coordinates), 6))

    def direction(self, coordinate: float) -> Vectors:
        """Return the unit vector of the motion at q; not for the rigid model."""
        back, on = self.poses(coordinate + np.array([-1e-4, 1e-4]))[:, :3]
        return np.asarray((on - back) / math.dist(on, back))

    def bic(self, path: Path) -> float:
        """Return the Bayesian information criterion of this model for a path."""
        errors = (path - self.poses(self.coordinates(path[:, :3]))) / _STD
        density = (1.0 - _OUTLIERS) / np.prod(math.sqrt(2.0 * math.pi) * _STD)
        inliers = math.log(density) - 0.5 * np.add.reduce(errors**2, axis=1)
        points = np.logaddexp(inliers, math.log(_OUTLIERS / (8.0 * math.pi**2)))
        weight = self.parameters + 2 * self.degrees * len(path)
        return float(-2.0 * points.sum() + weight * math.log(len(path)))


class Prismatic(MotionModel):
    """The hand moves along a line, by regression with the pull as its prior."""

    degrees, parameters = 1, 8

    def __init__(self, pull: Vectors, line: Vectors) -> None:
        self._pull, self._line = pull, line

    def updated(self, path: Path) -> Prismatic:
        """Return the most probable line."""
        points = path[:, :3]
        evidence = np.linalg.norm(points, axis=1) @ points / _STD[0] ** 2
        line = evidence + self._pull / UPRIGHT.heading_std**2
        return Prismatic(self._pull, line / math.sqrt(line @ line))

    def coordinates(self, positions: Vectors) -> PerRow:
        """Return the distances along the line."""
        return np.asarray(positions @ self._line)

    def poses(self, coordinates: PerRow | float) -> Axes:
        """Return poses on the line, without rotation."""
        lengths = np.asarray(coordinates)[..., None]
        return np.asarray(lengths * np.append(self._line, np.zeros(3)))


class Rotational(MotionModel):
    """The hand moves on a circle and turns with it, see `circle`."""

    degrees, parameters = 1, 9

    def __init__(self, circle: Circle) -> None:
        self._circle, self._door = circle, circle.door()
        self.radius = self._door.radius

    @classmethod
    def expected(cls, pull: Vectors, hinge: Vectors) -> Rotational:
        """Return the prior estimate for a hinge in a direction from the hand."""
        axes = np.stack([pull, np.cross(pull, hinge), -hinge], axis=1)
        prior = CirclePrior(axes=axes)
        return cls(Circle(prior=prior, parameters=prior.mean))

    def updated(self, path: Path) -> Rotational:
        """Return the circle after another step of its fit."""
        return Rotational(self._circle.updated(path[:, :3]))

    def coordinates(self, positions: Vectors) -> PerRow:
        """Return lengths of arc."""
        return np.asarray(self.radius * self._door.angle(positions))

    def poses(self, coordinates: PerRow | float) -> Axes:
        """Return poses on the circle, turned by their angle."""
        return self._door.hand_poses(coordinates / self.radius)


class GaussianProcess(MotionModel):
    """The hand moves along any smooth path.

    Each component of f is a Gaussian process over the length of the path, with kernel
    a q q' + b (3 M - m) m²/6, m = min(q, q'), M = max(q, q'), an integrated Wiener
    process: its mean, a cubic spline, continues straight beyond the path.
    """

    degrees = 1

    def __init__(self, path: Path) -> None:
        chords = np.diff(path[:, :3], axis=0, prepend=0.0)
        lengths = np.cumsum(np.linalg.norm(chords, axis=1))
        count = min(-(-len(path) // _EVERY), _MOST)
        chosen = np.linspace(0, len(path), count + 1)[1:].round().astype(int) - 1
        self._places = lengths[chosen]
        kernel = _kernel(self._places[:, None], self._places)
        self._weights = np.linalg.solve(kernel + np.eye(count), path[chosen])
        self.parameters = 1 + self.degrees + 6 * count

    def updated(self, path: Path) -> GaussianProcess:
        """Return the process fitted to the path."""
        return GaussianProcess(path)

    def coordinates(self, positions: Vectors) -> PerRow:
        """Return the nearest lengths, by Newton's method from training lengths."""
        apart = positions[..., None, :] - self.poses(self._places)[:, :3]
        lengths = self._places[np.argmin((apart**2).sum(axis=-1), axis=-1)]
        for _ in range(3):
            here, ahead = self.poses(lengths), self.poses(lengths + 1e-4)
            slope = (ahead - here)[..., :3] / 1e-4
            along = ((positions - here[..., :3]) * slope).sum(axis=-1)
            lengths = lengths + along / (slope**2).sum(axis=-1)
        return np.asarray(lengths)

    def poses(self, coordinates: PerRow | float) -> Axes:
        """Return the posterior mean."""
        return _kernel(np.asarray(coordinates)[..., None], self._places) @ self._weights


def _kernel(first: Array, second: Array) -> Array:
    """Return the kernel; the path is also straight before the closed door."""
    least, most = np.minimum(np.maximum(first, 0.0), second), np.maximum(first, second)
    bend = _BEND * least**2 * (3.0 * most - least) / 6.0
    return np.asarray(_SLOPE * first * second + bend)


_GUESSES: Final = np.array([[1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1]], float)
"""Directions to try, task frame."""
_PATIENCE, _PLAY = 1.5, 4
"""Time for a direction [s]; segments within which the hand has not moved. Tuned."""
_LEAST_RADIUS: Final = 0.25
"""Least radius of a hinged leaf by which its end is computed [m]."""
_SPEED: Final = 0.12  # speed of the set-point [m/s]. Tuned
_ACCELERATION: Final = 0.06
"""Acceleration and deceleration of the set-point [m/s²]. Tuned."""


class MechanismFitAgent(StartedAgent):
    """Finds the mechanism while it opens the door, and follows the most probable one.

    As in `HingeFitAgent`, the hand yields to every force except the door's resistance
    along the path. The agent begins by pulling straight back. If the hand stays within
    two centimetres for 1.5 seconds, it tries the next direction. A rotational motion
    ends at 67°, like the demonstrations; another when the load rule stops it.
    """

    def _begin(self, guess: int) -> None:
        """Try a direction from the closed door."""
        pull = _GUESSES[guess % len(_GUESSES)]
        self._guess, self._fading = guess, np.zeros(6)
        self._travelled = self._speed = self._tried = 0.0
        self._path = HandPath(6)
        self.model: MotionModel = Prismatic(pull, line=pull)
        sides = [side for side in (*np.eye(3), *-np.eye(3)) if side @ pull == 0.0]
        self._candidates: list[MotionModel] = [
            *(MotionModel(np.zeros(6)), self.model, GaussianProcess(np.zeros((1, 6)))),
            *(Rotational.expected(pull, side) for side in sides),
        ]

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed door."""
        self._set_point = CompliantSetPoint()
        self._begin(0)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        if self._path.add(hand):
            path, before = self._path.points, self.model.poses(self._travelled)
            self._candidates = [model.updated(path) for model in self._candidates]
            best = min(self._candidates, key=lambda model: model.bic(path))
            if best.degrees > 0:
                self.model = best
                self._travelled = max(float(best.coordinates(before[:3])), 0.0)
                # The command changes to a new estimate without a jump.
                self._fading += before - best.poses(self._travelled)

        # If nothing moves, the set-point returns before the next direction.
        self._tried += CONTROL_PERIOD
        stuck = self._tried > _PATIENCE and len(self._path.points) <= _PLAY
        if stuck and self._travelled == 0.0:
            self._begin(self._guess + 1)

        direction = self.model.direction(self._travelled)
        load = CARRIED.compensate(wrench, direction)
        left = math.inf
        if isinstance(self.model, Rotational):
            end = DEMONSTRATED_ANGLE * max(self.model.radius, _LEAST_RADIUS)
            left = max(end - self._travelled, 0.0)
        self._speed = accelerated(self._speed, left, _ACCELERATION, _SPEED)
        step = self._speed * CONTROL_PERIOD * (-1.0 if stuck else float(load.pace))
        self._travelled = max(self._travelled + step, 0.0)
        self._fading *= JUMP_DECAY
        desired = self.model.poses(self._travelled) + self._fading
        return self._set_point.step(desired, load.compliant_wrench)
