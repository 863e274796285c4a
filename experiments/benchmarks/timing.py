"""CPU time of several candidates, measured so that their ratios can be trusted.

All candidates of a comparison run in turns within one process, with one BLAS thread:
what else the machine does then weighs on all of them alike.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Action = Callable[[], object]
"""Something to be timed; its result is dropped."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CpuTime:
    """CPU seconds of one operation over repeated measurements."""

    median: float
    """Median [s]."""
    low: float
    """First quartile [s]."""
    high: float
    """Third quartile [s]."""
    repeats: int
    """Number of measurements."""

    @classmethod
    def of(cls, seconds: list[float]) -> CpuTime:
        """Summarise the seconds of at least one measurement."""
        low, median, high = np.quantile(seconds, [0.25, 0.5, 0.75])
        return cls(
            median=float(median), low=float(low), high=float(high), repeats=len(seconds)
        )

    def __str__(self) -> str:
        """Milliseconds with the quartiles, such as ``1.20 [1.18, 1.31]``."""
        return f"{_ms(self.median)} [{_ms(self.low)}, {_ms(self.high)}]"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:#.3g}".rstrip(".")


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """One entrant of a comparison."""

    prepare: Callable[[], Action]
    """Makes the action; not timed, called before every measurement."""
    operations: int = 1
    """Operations in one action; times are per operation."""


def repeated(action: Action, operations: int = 1) -> Candidate:
    """Return a candidate that needs no preparation.

    Args:
        action: One operation.
        operations: How often a measurement runs it: many for very short ones.
    """

    def many() -> None:
        for _ in range(operations):
            action()

    return Candidate(prepare=lambda: many, operations=operations)


def interleaved(
    candidates: Mapping[str, Candidate], repeats: int
) -> dict[str, CpuTime]:
    """Measure every candidate ``repeats`` times, in turns.

    A first round warms caches up and is not counted, except for a single repeat.

    Args:
        candidates: Entrants by name.
        repeats: Counted measurements of each, at least 1.

    Returns:
        CPU time per operation by name.

    Raises:
        ValueError: ``repeats`` is less than 1.
    """
    if repeats < 1:
        raise ValueError(f"repeats must be 1 or more, got {repeats}")
    warm_up = 1 if repeats > 1 else 0
    seconds: dict[str, list[float]] = {name: [] for name in candidates}
    for round_ in range(warm_up + repeats):
        for name, candidate in candidates.items():
            elapsed = _cpu_seconds(candidate.prepare()) / candidate.operations
            if round_ >= warm_up:
                seconds[name].append(elapsed)
    return {name: CpuTime.of(values) for name, values in seconds.items()}


def _cpu_seconds(action: Action) -> float:
    collecting = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        started = time.process_time()
        action()
        return time.process_time() - started
    finally:
        if collecting:
            gc.enable()
