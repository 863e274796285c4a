"""Dynamic movement primitives, the first method of Table 1.

Ijspeert et al., *Dynamical Movement Primitives*, Neural Computation 25(2), 2013; the
goal enters as in Pastor et al., ICRA 2009, and orientation as in Koutras and Doulgeri,
CoRL 2019. With τ the phase from start to end, x the phase variable (τ ẋ = -α_x x, 1 at
the start), ξ = (p, e) position [m] and orientation error [rad], ψ_i normalised
Gaussians:

    τ² ξ̈ = α β (ξ_g - ξ) - α τ ξ̇ - α β (ξ_g - ξ_0) x + f(x),   β = α / 4
    f(x) = x Σ_i ψ_i(x) W_i: it fades with x, so the goal always attracts

e = 2 log(q_g q*) is the rotation vector from q to the goal q_g, so that every component
is a separate damped oscillator; with the angular velocity instead of -ė they are
coupled (``test_forcing_superposes_in_the_error_and_not_in_the_angular_velocity``). f(x)
is not scaled by goal minus start, which may be noise.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_env.spatial.turns import accumulated_rotvecs
from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Float, Outputs, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.movement import (
    EmpiricalDistribution,
    GaussianTrajectory,
    LearnedMovement,
    checked_times,
    white_covariance,
)

_STEPS = 1000  # integration steps per τ
_SETTLED = 1e-6
"""The rollout ends when x and the unforced transient have fallen to this share."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DMPConfig(Quantities):
    """Constants of a dynamic movement primitive."""

    n_basis: int = quantity(30, low=2)
    """Basis functions of the forcing term."""
    alpha: float = quantity(25.0, above=0.0)
    """Gain α, critically damped with β = α/4; its natural frequency is α/2 per τ."""
    alpha_x: float = quantity(25.0 / 3.0, above=0.0)
    """Decay α_x of the phase variable: x ends at exp(-α_x)."""
    overlap: float = quantity(0.8, above=0.0, below=1.0)
    """Height of a basis function at the centre of the next."""
    spread: bool = False
    """Whether the demonstrations' spread is used as uncertainty."""


@dataclass(frozen=True, kw_only=True, repr=False)
class DynamicMovementPrimitive(LearnedMovement):
    """A point attractor shaped by a learned forcing term; made by `fit_dmp`, immutable.

    Its spread is NaN unless `DMPConfig.spread`. It has no via-points.
    """

    config: DMPConfig
    start: Pose
    goal: Pose
    """Pose of the attractor [m, rad]; the start is at the first demonstrated phase."""
    start_error: Float[np.ndarray, " 3"]
    """e_0, the rotation vector from start to goal [rad]."""
    weights: Float[np.ndarray, "N 6"]
    """W, the weights of the forcing term."""

    def predict(self, times: Times) -> GaussianTrajectory:
        """The rollout at ``times``; without a spread, std and covariance are NaN.

        Before the first phase it is the start; after the last it goes on to the goal.
        """
        times = checked_times(times)
        within = np.clip(times, self._rollout.x[0], self._rollout.x[-1])
        moving = (within == times)[:, None]
        mean = self._rollout(within)
        mean_rate = np.where(moving, self._rollout(within, 1), 0.0)
        if self.config.spread:
            demonstrated = EmpiricalDistribution(aligned=self.aligned).predict(times)
            return replace(demonstrated, mean=mean, mean_rate=mean_rate)
        unknown = np.full((times.size, 6), np.nan)
        return GaussianTrajectory(
            times=times,
            mean=mean,
            std=unknown,
            mean_rate=mean_rate,
            std_rate=unknown,
            covariance_function=partial(white_covariance, unknown),
        )

    @cached_property
    def _rollout(self) -> Any:
        """Poses from the first demonstrated phase until the goal is reached."""
        config, phases = self.config, self.aligned.times
        slowest = min(config.alpha_x, 0.4 * config.alpha)  # (1 + αt/2) exp(-αt/2)
        horizon = -np.log(_SETTLED) / slowest
        clock = np.linspace(0.0, horizon, int(np.ceil(horizon * _STEPS)) + 1)
        tau = float(phases[-1] - phases[0])
        state_0 = np.concatenate([self.start[:3], self.start_error])
        state_g = np.concatenate([self.goal[:3], np.zeros(3)])
        # Learned up to the last demonstrated phase; then only the attractor acts.
        forcing = np.where(
            clock[:, None] <= 1.0, forcing_basis(clock, config) @ self.weights, 0.0
        )
        drive = forcing + _pull(clock, state_0, state_g, config)
        # ξ̈ + α ξ̇ + α β ξ = drive, exactly for a drive linear between its samples.
        dynamics = np.array([[0.0, 1.0], [-0.25 * config.alpha**2, -config.alpha]])
        system = (
            np.kron(dynamics, np.eye(6)),
            np.kron([[0.0], [1.0]], np.eye(6)),
            np.kron([[1.0, 0.0]], np.eye(6)),
            np.zeros((6, 6)),
        )
        start = np.append(state_0, np.zeros(6))
        _, solved, _ = scipy.signal.lsim(system, drive, clock, X0=start)
        states = np.array(solved)
        states[-1] = state_g  # the remainder of x is ignored after the rollout
        rotvecs = compose_rotvecs(-states[:, 3:], self.goal[3:])
        rotvecs = unwrap_rotvecs(np.vstack([self.start[3:], rotvecs]))
        rotvecs = accumulated_rotvecs(rotvecs)[0][1:]
        return scipy.interpolate.CubicSpline(
            phases[0] + tau * clock, np.hstack([states[:, :3], rotvecs])
        )


def fit_dmp(
    aligned: AlignedDemonstrations, config: DMPConfig = DMPConfig()
) -> DynamicMovementPrimitive:
    """Learn a dynamic movement primitive from the mean of the demonstrations.

    The forcing term that reproduces it exactly follows from its derivatives and the
    transformation system; the weights fit it by least squares. Ends are taken to rest.
    """
    phases, mean = aligned.times, aligned.poses.mean(axis=0)
    errors = compose_rotvecs(mean[-1, 3:], -mean[:, 3:])
    # The error is zero at the end; it is computed backwards from there.
    errors, _ = accumulated_rotvecs(unwrap_rotvecs(errors[::-1]))
    states = np.hstack([mean[:, :3], errors[::-1]])
    clock = (phases - phases[0]) / (phases[-1] - phases[0])
    path = scipy.interpolate.CubicSpline(clock, states, bc_type="clamped")
    target = (
        path(clock, 2)
        + config.alpha * path(clock, 1)
        + 0.25 * config.alpha**2 * states
        - _pull(clock, states[0], states[-1], config)
    )
    weights = np.linalg.lstsq(forcing_basis(clock, config), target, rcond=None)[0]
    return DynamicMovementPrimitive(
        aligned=aligned,
        config=config,
        start=mean[0],
        goal=mean[-1],
        start_error=states[0, 3:],
        weights=weights,
    )


def forcing_basis(clock: Times, config: DMPConfig) -> np.ndarray:
    """Products x ψ_i(x) at times of the clock, 0 to 1 in τ, (M, n_basis)."""
    x = np.exp(-config.alpha_x * clock)
    centres = np.exp(-config.alpha_x * np.linspace(0.0, 1.0, config.n_basis))
    spacing = -np.diff(centres)
    sharpness = -np.log(config.overlap) / np.append(spacing, spacing[-1]) ** 2
    exponents = -sharpness * (x[:, None] - centres) ** 2
    # The nearest function is 1 before normalisation, even where all others vanish.
    values = np.exp(exponents - exponents.max(axis=1, keepdims=True))
    return np.asarray(x[:, None] * values / values.sum(axis=1, keepdims=True))


def _pull(clock: Times, start: Pose, goal: Pose, config: DMPConfig) -> Outputs:
    """α β (ξ_g - (ξ_g - ξ_0) x), the attraction to the goal, which starts gently."""
    x = np.exp(-config.alpha_x * clock)[:, None]
    return np.asarray(0.25 * config.alpha**2 * (goal - (goal - start) * x))
