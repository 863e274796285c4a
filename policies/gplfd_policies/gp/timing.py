"""How repetitions run early or late.

Demonstration k reaches phase t at its own clock_k(t), which the alignment found:
δτ_k(t) = clock_k(t) − t. This is not in the paper, whose alignment drops the clocks. A
repetition's δτ is a process of zero mean with the covariance

    K_τ(t, t') = (1 + 1/D) [(1 − _STATIONARY) S(t, t') + _STATIONARY s s' k(t, t'; ℓ)],

S the covariance of the demonstrations' own, s² its diagonal and k a unit RBF: a few
clocks span only a few shapes, and the next may take another of the same size
(``test_timing_covariance_has_the_size_of_the_clocks``).
"""

import numpy as np
from jaxtyping import Float

from gplfd_policies.gp.kernels import RBF

_STATIONARY = 0.5
"""Share of the variance that may take any smooth shape."""
_SCALE = 0.25
"""ℓ, as a fraction of the task."""


def timing_covariance(
    times: Float[np.ndarray, " M"],
    clocks: Float[np.ndarray, "D M"],
    phases: Float[np.ndarray, " N"],
) -> Float[np.ndarray, "N N"]:
    """K_τ at any phases.

    Args:
        times: common phases, shape (M,).
        clocks: own clock of D ≥ 2 demonstrations there, shape (D, M).
        phases: where K_τ is wanted, shape (N,); as at the ends beyond them.
    """
    count = len(clocks)
    late = np.stack([np.interp(phases, times, clock - times) for clock in clocks])
    sample = late.T @ late / (count - 1)
    std = np.sqrt(np.diag(sample))
    kernel = RBF(length_scale=_SCALE * float(times[-1] - times[0]), signal_std=1.0)
    smooth = std[:, None] * kernel(phases, phases) * std
    covariance: np.ndarray = (1.0 - _STATIONARY) * sample + _STATIONARY * smooth
    return (1.0 + 1.0 / count) * covariance
