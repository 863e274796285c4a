"""Probabilistic dynamic movement primitives; not in Table 1.

Li et al., *ProDMP: A Unified Perspective on Dynamic and Probabilistic Movement
Primitives*, RA-L 8(4), 2023, arXiv:2210.01531. The equation of a dynamic movement
primitive, with z the time in τ from the start of the demonstrations,

    y'' + α y' + α²/4 y = α²/4 g + Σ_i x(z) ψ_i(z) w_i,   x = exp(-α_x z),

is linear. From the state (y_b, y_b') at z = 0 it has the solution

    y(z) = Φ(z)ᵀ (w, g) + y_b (y_1 + α/2 y_2) + y_b' y_2,
    y_1 = exp(-α z/2),  y_2 = z y_1,  Φ_g = 1 - y_1 - α/2 y_2,
    Φ_i = y_2 ∫_0^z x ψ_i / y_1 ds - y_1 ∫_0^z s x ψ_i / y_1 ds.

(w, g) is Gaussian across all outputs, y_b and y_b' are known: all are weights as in
`gplfd_policies.movements.baselines.promp`. Choices, apart from leaving out the network:

* Outputs are position and rotation vector. The start is the mean of all starts, but
  each demonstration is fitted from its own start.
* Responses Φ are scaled to a maximum of 1 within the task, as in the paper. They
  overlap so much that conditioning on their weights would depend on rounding. Therefore
  Φ is made orthonormal over the demonstrated phases, Φ R⁻¹ with the weights R (w, g),
  where Rᵀ R = ΦᵀΦ and the ridge
  (``test_contradicting_demands_of_no_tolerance_have_an_answer``).
* Σ is shrunk to white deviations of the demonstrated variance.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Float, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.baselines.dmp import DMPConfig, forcing_basis
from gplfd_policies.movements.baselines.promp import (
    RIDGE,
    Basis,
    WeightMovement,
    learn_weights,
)
from gplfd_policies.movements.skill import SIZE_STD

_LONGEST: Final = 5.0
"""Time in τ at which the response ends, as in the paper: x = exp(-15)."""
_STEPS: Final = 1000  # steps of the quadrature per τ


@dataclass(frozen=True, kw_only=True, slots=True)
class ProDMPConfig(Quantities):
    """Constants of a probabilistic dynamic movement primitive."""

    n_basis: int = quantity(20, low=2)
    """Basis functions ψ_i of the forcing term; centres evenly in time, 0 to τ."""
    alpha: float = quantity(25.0, above=0.0, high=100.0)
    """Gain α, critically damped; published."""
    alpha_x: float = quantity(3.0, above=0.0)
    """Decay α_x of the phase variable; published."""
    overlap: float = quantity(0.22, above=0.0, below=1.0)
    """Height of a basis function at the centre of the next; published exp(-3/2)."""
    shrinkage: float = quantity(1e-3, low=0.0, high=1.0)
    """Share of white deviations in Σ, the covariance of weights and goal."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ProbabilisticDynamicMovementPrimitive(WeightMovement):
    """A Gaussian over forcing terms and goals; made by `fit_prodmp`, immutable.

    Before the first demonstrated phase the pose is the start; after the last one the
    attractor continues to the goal. The weights of an output are R (w, g), y_b, y_b'.
    """

    config: ProDMPConfig
    triangle: Float[np.ndarray, "B B"]
    """R, upper triangular, which makes the responses orthonormal."""

    def basis(self, times: Times) -> Basis:
        """(Φ R⁻¹, y_1 + α/2 y_2, y_2), and its derivative per unit phase."""
        phases = self.aligned.times
        clock = (times - phases[0]) / (phases[-1] - phases[0])
        within = np.clip(clock, 0.0, _LONGEST)
        moving = (within == clock)[:, None] / (phases[-1] - phases[0])
        spline = position_basis(self.config)
        basis, slope = spline(within), moving * spline(within, 1)
        for rows in (basis, slope):
            rows[:, :-2] = orthonormal(rows[:, :-2], self.triangle)
        return basis, slope


def fit_prodmp(
    aligned: AlignedDemonstrations, config: ProDMPConfig = ProDMPConfig()
) -> ProbabilisticDynamicMovementPrimitive:
    """Learn weights and goals by ridge regression, and their mean and covariance."""
    tau = aligned.times[-1] - aligned.times[0]
    basis = position_basis(config)((aligned.times - aligned.times[0]) / tau)
    starts = aligned.poses[:, 0]
    rates = np.gradient(aligned.poses.mean(axis=0), aligned.times / tau, axis=0)
    basis, resting, coasting = basis[:, :-2], basis[:, -2, None], basis[:, -1, None]
    driven = aligned.poses - resting * starts[:, None] - coasting * rates[0]
    size = basis.shape[1]
    penalised = np.vstack([basis, np.sqrt(RIDGE) * np.eye(size)])
    triangle = np.asarray(np.linalg.qr(penalised, mode="r"))
    basis = orthonormal(basis, triangle)
    learned = learn_weights(driven, basis, basis.T)
    # Within the span of the basis, white deviations of the demonstrated variance.
    if len(driven) > 1:
        variance = driven.var(axis=0, ddof=1).mean(axis=0)
    else:
        variance = ((SIZE_STD * driven[0]) ** 2).mean(axis=0)
    white = np.repeat(variance * (len(basis) / size), size)
    covariance = (1.0 - config.shrinkage) * learned["weight_covariance"]
    covariance += config.shrinkage * np.diag(white)
    covariance = np.pad(covariance.reshape(6, size, 6, size), ((0, 0), (0, 2)) * 2)
    mean = learned["weight_mean"].reshape(6, size).T
    return ProbabilisticDynamicMovementPrimitive(
        aligned=aligned,
        config=config,
        triangle=triangle,
        weight_mean=np.vstack([mean, starts.mean(axis=0), rates[0]]).T.ravel(),
        weight_covariance=covariance.reshape(6 * (size + 2), -1),
        noise_variance=learned["noise_variance"],
    )


def orthonormal(
    responses: Float[np.ndarray, "M B"], triangle: Float[np.ndarray, "B B"]
) -> Float[np.ndarray, "M B"]:
    """Φ R⁻¹."""
    solved = scipy.linalg.solve_triangular(triangle, responses.T, trans="T")
    return np.asarray(solved.T)


@lru_cache(maxsize=64)
def position_basis(config: ProDMPConfig) -> Any:
    """(Φ, y_1 + α/2 y_2, y_2), Φ scaled, as a spline of the time z in τ, from 0 on."""
    z = np.linspace(0.0, _LONGEST, round(_LONGEST * _STEPS) + 1)[:, None]
    damping = 0.5 * config.alpha
    y_1 = np.exp(-damping * z)
    slope_1, slope_2 = -damping * y_1, (1.0 - damping * z) * y_1
    system = {name: getattr(config, name) for name in ("n_basis", "alpha_x", "overlap")}
    forcing = forcing_basis(z[:, 0], DMPConfig(**system))
    p_1, p_2 = (
        scipy.integrate.cumulative_simpson(integrand, dx=1 / _STEPS, axis=0, initial=0)
        for integrand in (z * forcing / y_1, forcing / y_1)
    )
    resting, slope = y_1 + damping * z * y_1, slope_1 + damping * slope_2
    values = np.hstack([z * y_1 * p_2 - y_1 * p_1, 1.0 - resting, resting, z * y_1])
    slopes = np.hstack([slope_2 * p_2 - slope_1 * p_1, -slope, slope, slope_2])
    scale = values[: _STEPS + 1].max(axis=0)
    scale[-2:] = 1.0
    return scipy.interpolate.CubicHermiteSpline(z[:, 0], values / scale, slopes / scale)
