"""How well predicted Gaussians fit what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""Half-width of the central 95 % of a standard normal."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Score:
    """Means over all held-out numbers."""

    nlpd: float
    """Negative log predictive density per number, of the Gaussian."""
    coverage: float
    """Share within mean ± 1.96 std; 0.95 if the standard deviation is right."""
    interval_coverage: float | None = None
    """Share within the 95 % interval that the policy itself states, which knows of few
    demonstrations; None for libraries that state none."""

    @classmethod
    def mean_of(cls, scores: Sequence[Score]) -> Score:
        """Average scores of equally many numbers.

        Raises:
            ValueError: There is none.
        """
        if not scores:
            raise ValueError("there are no scores to average")
        stated = [
            s.interval_coverage for s in scores if s.interval_coverage is not None
        ]
        return cls(
            nlpd=float(np.mean([score.nlpd for score in scores])),
            coverage=float(np.mean([score.coverage for score in scores])),
            interval_coverage=float(np.mean(stated)) if stated else None,
        )


def score(
    held_out: Array,
    mean: Array,
    std: Array,
    interval: tuple[Array, Array] | None = None,
) -> Score:
    """Score a prediction.

    Args:
        held_out: Values that were not learned from, (..., M, 6).
        mean: Predicted mean, (M, 6).
        std: Predicted standard deviation, (M, 6), positive.
        interval: Lower and upper bound of the stated 95 % interval, (M, 6) each.
    """
    error = (held_out - mean) / std
    density = 0.5 * np.log(2.0 * np.pi) + np.log(std) + 0.5 * error**2
    stated = None
    if interval is not None:
        low, high = interval
        stated = float(np.mean((held_out >= low) & (held_out <= high)))
    return Score(
        nlpd=float(np.mean(density)),
        coverage=float(np.mean(np.abs(error) <= NORMAL_95)),
        interval_coverage=stated,
    )
