"""Criteria for the marks of Table 1: limits of numbers, and a sentence, per row.

The rows and marks are those of Arduengo et al., *Gaussian-Process-based Robot Learning
from Demonstration*, arXiv:2002.09979; the criteria in ``criteria.toml`` are our own.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence, Set
from pathlib import Path
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


_FILE: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
CRITERIA: Final[Mapping[str, Criterion]] = {
    row: Criterion(
        row,
        tuple(Limit(**limit) for limit in entry["limits"]),
        entry["sentence"],
        frozenset(entry["paper"]),
    )
    for row, entry in _FILE.items()
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
