"""Which phase does an observed pose belong to?

The policy of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, is a function of time, but a compliant robot lags
behind the clock. Conditioning on "at clock time t the hand is here" makes the policy
believe in its own lag. Progress is therefore told from the path: the phase of an
observation is the one at which the *demonstrations* come nearest to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from policies.skill import Skill

_GRID: Final = np.linspace(0.0, 1.0, 201)
_LEAST_STD: Final = 0.003
_LARGEST_STD: Final = 0.1


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseNoise:
    """Errors of an observed pose that no demonstration shows."""

    position: float = 2e-3
    """Compliance and slip of the grasp [m]."""

    rotation: float = 0.15
    """Turning of the hand on the bar [rad]. A friction grasp transmits a few tenths of
    a newton metre: under load the hand turns before the door does, and a phase that
    trusted its rotation would run ahead of a door that has not moved."""


@runtime_checkable
class PhaseRule(Protocol):
    """Tells the phase of an observed pose."""

    def reset(self) -> None:
        """Begin at the start of the task."""

    def update(
        self, pose: Float[np.ndarray, " 6"], command_phase: float
    ) -> tuple[float, float]:
        """Return the phase of an observed pose and its standard deviation."""

    def rate(self, phase: float) -> Float[np.ndarray, " 6"]:
        """Return dμ/ds of the demonstrations at a phase, (6,)."""


class ClockPhase:
    """The phase of an observation is that of the command: the paper's time.

    Note:
        A hand that lags behind its command teaches the policy its lag; see
        `PathPhase`.
    """

    def reset(self) -> None:
        """Nothing to forget."""

    def update(
        self, pose: Float[np.ndarray, " 6"], command_phase: float
    ) -> tuple[float, float]:
        """Return the command phase, as if it were certain."""
        return command_phase, 0.0

    def rate(self, phase: float) -> Float[np.ndarray, " 6"]:
        """Return zero: a certain phase makes no via-point weaker."""
        return np.zeros(6)


class PathPhase:
    """The phase at which the demonstrated distribution is nearest to a pose.

    The features are the pose itself and the direction u = v/|v| of the hand's
    displacement from the closed handle. Doors of different radius share that direction
    at equal phase, though neither x nor z: it tells progress independently of the
    radius and of how the hand lies on the bar. Nearest is meant after Mahalanobis,

        d²(s) = Σ_i (y_i - μ_i)²/(σ_i² + n_i²) + |u - û|²/(ς² + n_v²/|v|²),

    with the demonstrations' means μ(s), û(s) and variances σ(s)², ς(s)², and the
    errors n of `PhaseNoise`. The logarithms that would make it a likelihood are left
    out: they favour early phases, where the demonstrations agree, over the hand's
    progress. From the curvature of d² the phase has a standard deviation; the position
    counts twice, as pose and as direction, so it is right to a factor only.

    The distribution is the one before adaptation, so that the estimate cannot follow
    the policy's belief in the robot's own errors. The search stays near the last phase.

    Args:
        skill: The demonstrated skill.
        noise: Errors of the observed pose beyond the demonstrations' spread.
        window: How far the phase may move per observation: backward, forward.
    """

    def __init__(
        self,
        skill: Skill,
        *,
        noise: PhaseNoise | None = None,
        window: tuple[float, float] = (0.02, 0.05),
    ) -> None:
        noise = PhaseNoise() if noise is None else noise
        demonstrated = skill.predict(_GRID)
        floor = np.repeat([noise.position, noise.rotation], 3)
        self._mean = demonstrated.mean
        self._rate = demonstrated.mean_rate
        self._precision = 1.0 / (demonstrated.std**2 + floor**2)
        self._direction, self._direction_variance = _directions(skill)
        self._noise = noise
        self._window = window
        self._phase = 0.0

    def reset(self) -> None:
        """Return to the beginning of the task."""
        self._phase = 0.0

    def update(
        self, pose: Float[np.ndarray, " 6"], command_phase: float
    ) -> tuple[float, float]:
        """Return the phase of an observed pose and its standard deviation.

        Args:
            pose: Hand pose in the task frame [m, rad].
            command_phase: Not used: the path tells, not the clock.
        """
        spacing = float(_GRID[1])
        backward, forward = self._window
        first = max(0, math.floor((self._phase - backward) / spacing) - 1)
        last = min(_GRID.size, math.ceil((self._phase + forward) / spacing) + 2)
        cost = self._cost(pose, slice(first, last))
        best = int(cost.argmin())
        std = _LARGEST_STD
        self._phase = float(_GRID[first + best])
        if 0 < best < cost.size - 1:
            before, here, after = cost[best - 1 : best + 2].tolist()
            curvature = before - 2.0 * here + after
            if curvature > 0.0:
                self._phase += 0.5 * (before - after) / curvature * spacing
                std = spacing * math.sqrt(2.0 / curvature)
        return self._phase, min(max(std, _LEAST_STD), _LARGEST_STD)

    def rate(self, phase: float) -> Float[np.ndarray, " 6"]:
        """Return dμ/ds of the demonstrations at a phase, (6,)."""
        rate: Float[np.ndarray, " 6"] = self._rate[round(phase / float(_GRID[1]))]
        return rate

    def _cost(
        self, pose: Float[np.ndarray, " 6"], near: slice
    ) -> Float[np.ndarray, " N"]:
        deviation = self._mean[near] - pose
        cost: Float[np.ndarray, " N"] = (deviation**2 * self._precision[near]).sum(
            axis=1
        )
        x, y, z = pose[:3].tolist()
        distance = math.sqrt(x * x + y * y + z * z) + 1e-9
        variance = (
            self._direction_variance[near] + (self._noise.position / distance) ** 2
        )
        deviation = self._direction[near] - pose[:3] / distance
        cost += (deviation**2).sum(axis=1) / variance
        return cost


def _directions(
    skill: Skill,
) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, " M"]]:
    """Mean direction of displacement, and its spread over the demonstrations [rad²]."""
    positions = np.stack(
        [
            np.stack(
                [np.interp(_GRID, skill.aligned.times, curve) for curve in pose.T[:3]],
                axis=1,
            )
            for pose in skill.aligned.poses
        ]
    )
    length = np.linalg.norm(positions, axis=2, keepdims=True)
    # A displacement of a millimetre has no direction yet.
    unit = positions / np.maximum(length, 1e-3)
    mean = unit.mean(axis=0)
    spread = ((unit - mean) ** 2).sum(axis=2).mean(axis=0) / 2.0
    return mean, spread + (1e-3 / np.maximum(length[..., 0].min(axis=0), 1e-3)) ** 2
