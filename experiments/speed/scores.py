"""How well a prediction fits what was held out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from policies.trajectory import GaussianTrajectory


def score(
    predicted: GaussianTrajectory, held_out: NDArray[np.float64]
) -> dict[str, float]:
    """Score a prediction, by column of a table.

    Args:
        predicted: At M phases.
        held_out: Poses at them that were not learned from, (..., M, 6) [m, rad].

    Returns:
        Negative log predictive density per number; the share within mean ± 1.96 std,
        0.95 if the standard deviation is right; and the share in the 95 % interval that
        the prediction itself states, which knows of few demonstrations.
    """
    density = np.asarray(norm.logpdf(held_out, predicted.mean, predicted.std))
    distance = np.abs(held_out - predicted.mean) / predicted.std
    low, high = predicted.interval(0.95)
    return {
        "NLPD": -float(density.mean()),
        "within 1.96 std": float(np.mean(distance <= norm.ppf(0.975))),
        "in stated 95 %": float(np.mean((held_out >= low) & (held_out <= high))),
    }
