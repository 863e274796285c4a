"""Criteria for the marks of Table 1: a number, limits and a sentence per row.

The rows are those of Table 1 in Arduengo et al., *Gaussian-Process-based Robot Learning
from Demonstration*, arXiv:2002.09979. Its marks state claims of publications. The
criteria are for measurements of this project's implementations.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class Limit:
    """Limits of a metric of a learning test, with its name and unit as text."""

    metric: str
    symbol: str
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, kw_only=True, slots=True)
class Criterion:
    """A row of Table 1: the measures, and the meaning of a missing number."""

    row: str
    limits: tuple[Limit, ...]
    """All limits must hold; the first has the number of the row."""
    sentence: str
    absent: str
    paper: frozenset[str]
    """Policies with the paper's mark."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Mark:
    """Mark of a method in a row: the mean of its number, and whether all limits hold.

    None without a number or without a measurement; the text states which.
    """

    value: float | None
    passed: bool | None
    text: str


_GAUSSIAN_PROCESSES: Final = frozenset({"local-gp", "wishart-gp"})
_OURS: Final = frozenset({"gp-paper", "gp"})

CRITERIA: Final[Mapping[str, Criterion]] = {
    criterion.row: criterion
    for criterion in (
        Criterion(
            row="High-dimensional Learning",
            limits=(
                Limit(
                    "outputs_nlpd_change",
                    "NLPD of z with six outputs less that with two",
                    high=0.3,
                ),
            ),
            sentence="Learning six outputs instead of two makes the density of one of "
            "them worse by at most 0.3 per number, what a standard deviation twice too "
            "large costs. The paper's mark is about high-dimensional inputs, too; "
            "every method here has one input, the phase.",
            absent="predicts no density",
            paper=_OURS | _GAUSSIAN_PROCESSES | {"gmr", "kmp", "gmm-gp"},
        ),
        Criterion(
            row="Via-point Adaptation",
            limits=(
                Limit("via_error_strict_position_m", "missed by [m]", high=0.002),
                Limit("via_error_strict_rotation_rad", "by [rad]", high=0.02),
                Limit("via_far_error", "far error, of that before", high=1.05),
            ),
            sentence="Three poses of a demonstration that was not learned from, "
            "demanded to 0.1 mm and 0.1 mrad, are met within 2 mm and 0.02 rad, and "
            "one of them leaves the mean farther away than 0.3 of the task no farther "
            "from that demonstration than it was: at most 1.05 times as far, in "
            "standard deviations. A method may use a via-point for the rest of the "
            "path, but the rest must not become worse. A weaker demand would judge the "
            "method's other assumptions.",
            absent="has no via-points",
            paper=_OURS | {"promp", "kmp", "gmm-gp"},
        ),
        Criterion(
            row="Task Variability",
            limits=(
                Limit("spread_followed", "correlation of std and spread", low=0.5),
            ),
            sentence="Along the task the standard deviation rises and falls with the "
            "spread of the demonstrations: their logarithms correlate by at least 0.5, "
            "where one level throughout has 0 and a copy 1.",
            absent="predicts no spread",
            paper=_OURS | _GAUSSIAN_PROCESSES | {"promp", "gmr", "kmp", "gmm-gp"},
        ),
        Criterion(
            row="Prediction Uncertainty",
            limits=(
                Limit(
                    "uncertainty_growth",
                    "growth of the std beyond the demonstrations",
                    low=1.5,
                ),
            ),
            sentence="Half as far beyond the end of the demonstrations as they are "
            "long, the standard deviation of what moves is at least 1.5 times that at "
            "their end; a method that only knows their spread holds it, and has 1.",
            absent="predicts no standard deviation",
            paper=_OURS | _GAUSSIAN_PROCESSES | {"kmp", "gmm-gp"},
        ),
        Criterion(
            row="Prior Information",
            limits=(
                Limit(
                    "prior_mean_used",
                    "return to a prior mean far beyond the demonstrations",
                    low=0.9,
                ),
            ),
            sentence="Given a prior mean 0.1 m and 0.3 rad beside the demonstrations, "
            "the prediction goes at least 0.9 of the way back to it far beyond them. "
            "The prior mean that a mixture learns from the demonstrations themselves "
            "does not count: nothing else can be given in its place.",
            absent="cannot be given a prior mean here",
            paper=_OURS | _GAUSSIAN_PROCESSES | {"gmm-gp"},
        ),
        Criterion(
            row="Task Space Rotations",
            limits=(
                Limit(
                    "tumbling_error",
                    "error of the mean orientation [std of a demonstration]",
                    high=1.0,
                ),
            ),
            sentence="The mean orientation of demonstrations that turn by more than π "
            "about changing axes is no farther from the true one than a single "
            "demonstration is. All methods are given unwrapped rotation vectors here, "
            "which the publications without the paper's mark do not mention.",
            absent="predicts no orientation",
            paper=_OURS | {"dmp", "promp", "gmr", "kmp"},
        ),
    )
}
"""Rows of Table 1 in the paper's order."""


def mark(criterion: Criterion, metrics: Sequence[Mapping[str, Any]]) -> Mark:
    """Return the mark of a method in a row."""
    means: dict[Limit, float] = {}
    for limit in criterion.limits:
        measured = [task[limit.metric] for task in metrics if limit.metric in task]
        if not measured:
            return Mark(value=None, passed=None, text="not measured")
        values = [float(value) for value in measured if value is not None]
        if values:
            means[limit] = sum(values) / len(values)
    if len(means) < len(criterion.limits):
        return Mark(value=None, passed=False, text=criterion.absent)
    return Mark(
        value=means[criterion.limits[0]],
        passed=all(limit.low <= mean <= limit.high for limit, mean in means.items()),
        text=", ".join(f"{limit.symbol} {mean:.3g}" for limit, mean in means.items()),
    )
