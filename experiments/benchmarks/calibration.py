"""How honest the stated uncertainty is on data of known distribution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.benchmarks.artificial import Deviations, KnownProcess
from experiments.benchmarks.report import Table, Target, number
from experiments.benchmarks.scores import Score, score
from policies.skill import fit_skill

__all__ = ["Calibration", "calibrate"]

_SAMPLES, _HELD_OUT = 200, 100
_CASES: tuple[tuple[Deviations, int], ...] = (
    ("independent", 6),
    ("independent", 20),
    ("smooth", 6),
    ("smooth", 20),
)


@dataclass(frozen=True, kw_only=True, slots=True)
class CalibrationRow:
    """One kind and number of demonstrations."""

    deviations: Deviations
    """How the demonstrations deviate."""
    demonstrations: int
    """How many were learned from."""
    score: Score
    """On others of the same distribution."""
    truth: Score
    """Score of the true distribution on the same."""

    @property
    def excess(self) -> float:
        """NLPD above that of the truth."""
        return self.score.nlpd - self.truth.nlpd


@dataclass(frozen=True, kw_only=True, slots=True)
class Calibration:
    """All kinds and numbers of demonstrations."""

    rows: tuple[CalibrationRow, ...]
    """One per kind and number."""

    def tables(self) -> tuple[Table, ...]:
        """One line per kind and number."""
        return (
            Table(
                title=f"accuracy: {_SAMPLES} samples, scored on {_HELD_OUT} other "
                "demonstrations",
                columns=(
                    *("", "NLPD above the truth's"),
                    *("within 1.96 std", "in stated 95 %"),
                ),
                rows=tuple(
                    (
                        f"{row.demonstrations} {row.deviations}",
                        number(row.excess),
                        number(row.score.coverage),
                        number(row.score.interval_coverage),
                    )
                    for row in self.rows
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Coverage of 95 %: within a point where the model is right, else near it."""
        targets = []
        for row in self.rows:
            name = f"accuracy, {row.demonstrations} {row.deviations}:"
            if row.deviations == "independent":
                targets.append(
                    Target(
                        name=f"{name} within 1.96 std",
                        value=row.score.coverage,
                        low=0.94,
                        high=0.96,
                    )
                )
            elif row.score.interval_coverage is not None:
                targets.append(
                    Target(
                        name=f"{name} in the stated 95 %",
                        value=row.score.interval_coverage,
                        low=0.92,
                    )
                )
        return tuple(targets)


def calibrate(seeds: int = 5) -> Calibration:
    """Score every case.

    Args:
        seeds: Number of draws per case, averaged.
    """
    process = KnownProcess.on_grid(_SAMPLES)
    rows = []
    for kind, count in _CASES:
        scores = [_scored(process, kind, count, seed) for seed in range(seeds)]
        rows.append(
            CalibrationRow(
                deviations=kind,
                demonstrations=count,
                score=Score.mean_of([ours for ours, _ in scores]),
                truth=Score.mean_of([true for _, true in scores]),
            )
        )
    return Calibration(rows=tuple(rows))


def _scored(
    process: KnownProcess, kind: Deviations, count: int, seed: int
) -> tuple[Score, Score]:
    rng = np.random.default_rng(seed)
    given = process.demonstrations(count, kind, rng)
    held_out = process.draw(_HELD_OUT, kind, rng)
    predicted = fit_skill(given).predict(process.times)
    ours = score(held_out, predicted.mean, predicted.std, predicted.interval(0.95))
    return ours, score(held_out, process.mean, process.std)
