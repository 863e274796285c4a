"""The paper's adaptation: a product of Gaussians, Eqs. (19)–(21)."""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from gplfd_env.validation.fields import check_choice
from gplfd_policies.arrays.records import read_only
from gplfd_policies.arrays.shapes import Curve, Gram, Outputs, Times
from gplfd_policies.gp.exact import ExactGP, factorise
from gplfd_policies.movements.movement import GaussianTrajectory, ViaPoint
from gplfd_policies.movements.skill import Skill

_STRONGEST = 1e-8
"""Least via-point variance relative to the prior's, also for repeated via-points."""


def product_of_gaussians(
    mean_d: Curve, covariance_d: Gram, mean_v: Curve, covariance_v: Gram
) -> tuple[Curve, Gram]:
    """μ** and Σ** of Eqs. (20)–(21), in a symmetric form without an inverse.

    With L Lᵀ = Σ^d + Σ^v and A = L⁻¹ Σ^d,

        Σ** = Σ^d (Σ^d + Σ^v)⁻¹ Σ^v = Σ^d − Aᵀ A,
        μ** = μ^d + Aᵀ L⁻¹ (μ^v − μ^d) (``test_product_equals_printed_equations``).
    """
    factor = factorise(covariance_d + covariance_v)
    half = factor.half_solve(covariance_d)
    mean = mean_d + half.T @ factor.half_solve(mean_v - mean_d)
    return mean, covariance_d - half.T @ half


class ProductAdaptation:
    """p(f | D) p(f | V) on the grid, Eqs. (19)–(21) as printed, O(M³) per via-point.

    * Each of the M predicted phases counts as another independent observation, so σ
      falls when the grid is refined (``test_product_depends_on_the_grid``).
    * Away from its via-points the via-point process returns to its prior mean. The
      paper's zero *pulls the policy to zero*; the default here, the demonstrations'
      mean, does not (``test_zero_prior_mean_pulls_the_policy``).
    """

    def __init__(
        self,
        skill: Skill,
        grid: Times,
        prior_mean: Literal["demonstration", "zero"] = "demonstration",
    ) -> None:
        """Start from the demonstrations, on strictly increasing phases (M,)."""
        check_choice("prior_mean", prior_mean, ("demonstration", "zero"))
        if np.any(np.diff(grid) <= 0.0):
            raise ValueError("The grid of a product must increase strictly.")
        self._skill, self._prior_mean = skill, prior_mean
        self._demonstrated = skill.predict(grid)
        self._via_points: list[ViaPoint] = []
        self._means = self._demonstrated.mean.copy()
        self._covariances = self._demonstrated.covariance.copy()

    def observe(self, via_point: ViaPoint) -> None:
        """Add a via-point: refit the via-point process and multiply again."""
        self._via_points.append(via_point)
        demonstrated, grid = self._demonstrated, self._demonstrated.times
        for output in range(6):
            if not np.isfinite(via_point.noise_variance[output]):
                continue
            # μ^v and Σ^v: Eqs. (10)–(11) on the via-points, without R at the grid.
            seen = [
                p for p in self._via_points if np.isfinite(p.noise_variance[output])
            ]
            process = self._skill.processes.outputs[output]
            signal_std = process.kernel.signal_std * process.scale
            kernel = replace(process.kernel, signal_std=signal_std)
            phases, values, noise = np.array(
                [(p.phase, p.pose[output], p.noise_variance[output]) for p in seen]
            ).T
            prior = np.zeros(len(grid))
            if self._prior_mean == "demonstration":
                prior = demonstrated.mean[:, output]
                values = values - self._skill.predict(phases).mean[:, output]
            noise = np.maximum(noise, _STRONGEST * kernel.signal_std**2)
            via = ExactGP(
                kernel=kernel, times=phases, values=values, noise_variance=noise
            )
            mean, covariance = product_of_gaussians(
                demonstrated.mean[:, output],
                demonstrated.covariance[output],
                prior + via.mean(grid),
                via.covariance(grid),
            )
            self._means[:, output] = mean
            self._covariances[output] = covariance

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid, read-only."""
        return read_only(self._means)

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid."""
        variances = np.diagonal(self._covariances, axis1=1, axis2=2)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)).T)

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution; after a via-point, rates are differences."""
        mean_rate, std_rate = self._demonstrated.mean_rate, self._demonstrated.std_rate
        grid = self._demonstrated.times
        if self._via_points and len(grid) > 1:
            order: Literal[1, 2] = 2 if len(grid) > 2 else 1
            mean_rate, std_rate = (
                np.gradient(curves, grid, axis=0, edge_order=order)
                for curves in (self.mean, self.std)
            )
        return GaussianTrajectory(
            times=grid,
            mean=self.mean,
            std=self.std,
            mean_rate=mean_rate,
            std_rate=std_rate,
            covariance_function=partial(np.asarray, self._covariances.copy()),
            degrees_of_freedom=self._skill.degrees_of_freedom,
        )
