"""Criteria for the marks of Table 1: limits of numbers, and a sentence, per row.

The rows and marks are those of Arduengo et al., *Gaussian-Process-based Robot Learning
from Demonstration*, arXiv:2002.09979; the criteria are for this project's methods.
"""

import math
from collections.abc import Mapping, Sequence, Set
from typing import Any, Final, NamedTuple


class Limit(NamedTuple):
    """Limits of a metric of a learning test, with its name and unit as text."""

    metric: str
    symbol: str
    low: float = -math.inf
    high: float = math.inf


class Criterion(NamedTuple):
    """A row of Table 1: its limits, a sentence, and policies with the paper's mark."""

    row: str
    limits: tuple[Limit, ...]
    """All limits must hold; the first has the number of the row."""
    sentence: str
    paper: Set[str]


class Mark(NamedTuple):
    """Mean of the number of a row, and whether all limits hold; None without one."""

    value: float | None
    passed: bool | None


_OURS: Final = {"gp-paper", "gp", "gmm-gp"}
_UNCERTAIN: Final = _OURS | {"local-gp", "wishart-gp", "kmp"}

CRITERIA: Final[Mapping[str, Criterion]] = {
    criterion.row: criterion
    for criterion in (
        Criterion(
            "High-dimensional Learning",
            (
                Limit(
                    "outputs_nlpd_change",
                    "NLPD of z with six outputs less that with two",
                    high=0.3,
                ),
            ),
            "Learning six outputs instead of two makes the density of one of them "
            "worse by at most 0.3 per number, what a standard deviation twice too "
            "large costs.",
            _UNCERTAIN | {"gmr"},
        ),
        Criterion(
            "Via-point Adaptation",
            (
                Limit("via_error_strict_position_m", "missed by [m]", high=0.002),
                Limit("via_error_strict_rotation_rad", "by [rad]", high=0.02),
                Limit("via_far_error", "far error, of that before", high=1.05),
            ),
            "Three poses of a demonstration that was not learned from, demanded to 0.1 "
            "mm and 0.1 mrad, are met within 2 mm and 0.02 rad, and one of them brings "
            "the mean farther away than 0.3 of the task to at most 1.05 times its "
            "distance from that demonstration, in standard deviations.",
            _OURS | {"promp", "kmp"},
        ),
        Criterion(
            "Task Variability",
            (Limit("spread_followed", "correlation of std and spread", low=0.5),),
            "Along the task the logarithms of the standard deviation and of the "
            "demonstrations' spread correlate by at least 0.5; one level throughout "
            "has 0 and a copy 1.",
            _UNCERTAIN | {"promp", "gmr"},
        ),
        Criterion(
            "Prediction Uncertainty",
            (
                Limit(
                    "uncertainty_growth",
                    "growth of the std beyond the demonstrations",
                    low=1.5,
                ),
            ),
            "Half as far beyond the end of the demonstrations as they are long, the "
            "standard deviation of what moves is at least 1.5 times that at their end; "
            "a method that keeps their spread has 1.",
            _UNCERTAIN,
        ),
        Criterion(
            "Prior Information",
            (
                Limit(
                    "prior_mean_used",
                    "return to a prior mean far beyond the demonstrations",
                    low=0.9,
                ),
            ),
            "Given a prior mean 0.1 m and 0.3 rad beside the demonstrations, the "
            "prediction goes at least 0.9 of the way back to it far beyond them.",
            _UNCERTAIN - {"kmp"},
        ),
        Criterion(
            "Task Space Rotations",
            (
                Limit(
                    "tumbling_error",
                    "error of the mean orientation [std of a demonstration]",
                    high=1.0,
                ),
            ),
            "The mean orientation of demonstrations that turn by more than π about "
            "changing axes is no farther from the true one than a single demonstration "
            "is. All methods are given unwrapped rotation vectors.",
            {"gp-paper", "gp", "dmp", "promp", "gmr", "kmp"},
        ),
    )
}
"""Rows of Table 1 in the paper's order."""


def mark(criterion: Criterion, metrics: Sequence[Mapping[str, Any]]) -> Mark:
    """Return the mark of a method in a row from its learning tests."""
    means: dict[Limit, float] = {}
    for limit in criterion.limits:
        measured = [task[limit.metric] for task in metrics if limit.metric in task]
        if not measured:
            return Mark(value=None, passed=None)
        values = [float(value) for value in measured if value is not None]
        if not values:
            return Mark(value=None, passed=False)
        means[limit] = sum(values) / len(values)
    return Mark(
        value=means[criterion.limits[0]],
        passed=all(limit.low <= mean <= limit.high for limit, mean in means.items()),
    )
