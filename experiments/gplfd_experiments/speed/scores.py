"""How well a prediction fits what was held out."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gplfd_policies.movements.trajectory import GaussianTrajectory


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
    return {
        "NLPD": predicted.nlpd(held_out),
        "within 1.96 std": predicted.coverage(held_out, normal=True),
        "in stated 95 %": predicted.coverage(held_out),
    }


def mean_scores(scores: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the mean of every column."""
    return {name: float(np.mean([one[name] for one in scores])) for name in scores[0]}
