"""Adaptation to via-points by the clock of a repetition, whose timing is unknown.

This form is ours. A repetition runs early or late: demonstration k reaches phase t at
its own clock_k(t), found by the alignment, so δτ_k(t) = clock_k(t) − t. The δτ of a
repetition is a process of zero mean with the covariance

    K_τ(t, t') = (1 + 1/D) [(1 − _STATIONARY) S(t, t') + _STATIONARY s s' k(t, t'; ℓ)],

S is the covariance of the demonstrations' δτ, s² its diagonal and k a unit RBF: a few
clocks span only a few shapes, and the next may have another shape of the same size
(``test_timing_covariance_has_the_size_of_the_clocks``). The timing error moves all
outputs together along the path:

    y_i(t) = m_i(t) + e_i(t) + λ ṁ_i(t) δτ(t),   δτ ~ N(0, K_τ).

The path may bend within the range of δτ. Mean and slope are therefore the best linear
approximation over N(0, K_τ(t, t)), E m(t + δτ) and E ṁ(t + δτ), and the residual is
added to the deviations (``test_timing_of_a_bend_has_its_moments``). Both cases are
conditioned, a clock of the repetition's own (λ = 1) and registered phases (λ = 0), and
weighted by the evidence of the via-points.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from gplfd_policies.adaptation.conditioning import Repetition, leading_curves
from gplfd_policies.adaptation.process import (
    MixedProcesses,
    StudentProcess,
    demonstrated_repetition,
)
from gplfd_policies.arrays.shapes import Curves, Float, Times
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.movements.skill import Skill

_STATIONARY: Final = 0.5
"""Share of the timing's variance that may take any smooth shape."""
_SCALE: Final = 0.25
"""Length-scale ℓ of these shapes, as a share of the task."""
_NEGLIGIBLE: Final = 1e-4
"""Eigenvectors of K_τ whose eigenvalue is below this share of the largest are left out:
a hundredth of the timing's spread is less than the variability of the hand."""
_POINTS: Final = 7
"""Quadrature points for averages over N(0, K_τ(t, t))."""


def timing_covariance(
    times: Times, clocks: Curves, phases: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "N N"]:
    """Return K_τ at phases, constant beyond both ends, from D ≥ 2 clocks."""
    count = len(clocks)
    late = np.stack([np.interp(phases, times, clock - times) for clock in clocks])
    sample = late.T @ late / (count - 1)
    std = np.sqrt(np.diag(sample))
    kernel = RBF(length_scale=_SCALE * float(times[-1] - times[0]), signal_std=1.0)
    smooth = std[:, None] * kernel(phases, phases) * std
    covariance: np.ndarray = (1.0 - _STATIONARY) * sample + _STATIONARY * smooth
    return (1.0 + 1.0 / count) * covariance


class OwnClockAdaptation(MixedProcesses):
    """Conditioning of path and timing, mixed with conditioning of the path alone.

    Args:
        skill: the demonstrated skill, from at least two demonstrations.
        grid: phases at which the distribution is reported.

    Raises:
        ValueError: if the demonstrations' clocks are not known, and as for
            `ProcessAdaptation`.
    """

    def __init__(self, skill: Skill, grid: Times) -> None:
        aligned = skill.aligned
        if aligned.clocks is None:
            raise ValueError(
                "Timing is learned from the demonstrations' clocks, which are missing: "
                "align the demonstrations with gplfd_policies.align, learn without a "
                'prior mean, or adapt with form="process", for which phases are '
                "certain."
            )
        registered = demonstrated_repetition(skill, grid)
        basis = registered.basis
        timing = timing_covariance(aligned.times, aligned.clocks, basis.nodes)
        free = float(skill.count - 1)
        parts = (
            StudentProcess(delayed(skill, registered, timing), free, grid),
            StudentProcess(registered, free, grid),
        )
        super().__init__(parts, (0.5, 0.5))


def delayed(
    skill: Skill, registered: Repetition, timing: Float[np.ndarray, "Q Q"]
) -> Repetition:
    """Return a repetition of unknown timing, from K_τ at the nodes of its basis."""
    basis, std = registered.basis, np.sqrt(np.diag(timing))
    points, weights = hermegauss(_POINTS)
    weights /= weights.sum()
    late = basis.nodes + np.multiply.outer(points, std)
    moved = skill.predict(np.clip(late, basis.start, basis.stop).ravel())
    means, slopes = (
        np.moveaxis(curve.reshape(_POINTS, basis.size, 6), 0, 2) @ weights
        for curve in (moved.mean, moved.mean_rate)
    )
    squares = np.moveaxis(moved.mean.reshape(_POINTS, basis.size, 6) ** 2, 0, 2)
    left = squares @ weights - means**2 - (slopes * std[:, None]) ** 2
    root = basis.root_weights[:, None]
    variance = np.sum((registered.deviations / root) ** 2, axis=2).T
    stretch = np.sqrt(1.0 + np.maximum(left, 0.0) / variance)
    return replace(
        registered,
        mean=root * means,
        slope=root * slopes,
        deviations=registered.deviations * stretch.T[:, :, None],
        timing=leading_curves(basis.weigh(timing), _NEGLIGIBLE),
    )
