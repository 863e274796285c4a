"""Learning six outputs: time and accuracy beside hetGP and scikit-learn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.artificial import Deviations, KnownProcess
from experiments.benchmarks.peers import hetgpy_fit, installed, sklearn_fit
from experiments.benchmarks.report import NOT_INSTALLED, Table, Target, number
from experiments.benchmarks.scores import Score, score
from experiments.benchmarks.timing import CpuTime, interleaved, repeated
from policies.aligned import AlignedDemonstrations
from policies.skill import fit_skill

__all__ = ["FitComparison", "compare_fits"]

Array = NDArray[np.float64]
Prediction = tuple[Array, Array, tuple[Array, Array] | None]

_OURS, _HETGPY, _SKLEARN = "gplfd", "hetgpy hetGP", "scikit-learn, collapsed"
_PEERS: Mapping[str, tuple[str, Callable[[Array, Array], tuple[Array, Array]]]] = {
    _HETGPY: ("hetgpy", hetgpy_fit),
    _SKLEARN: ("sklearn", sklearn_fit),
}
_KINDS: tuple[Deviations, ...] = ("independent", "smooth")
_DEMONSTRATIONS, _SAMPLES, _HELD_OUT = 6, 200, 100


@dataclass(frozen=True, kw_only=True, slots=True)
class FitRow:
    """One library on one kind of demonstrations."""

    library: str
    """Which library."""
    deviations: Deviations
    """How the demonstrations deviate."""
    time: CpuTime | None
    """CPU time to learn all six outputs; None: not installed."""
    score: Score | None
    """On demonstrations that were not learned from; None: not installed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FitComparison:
    """Six outputs of 6 demonstrations × 200 samples."""

    rows: tuple[FitRow, ...]
    """Libraries by kinds of demonstrations."""
    truth: Mapping[str, Score]
    """Score of the distribution the data came from, by kind."""

    def tables(self) -> tuple[Table, ...]:
        """One table for both kinds."""
        lines = [self._line(row) for row in self.rows]
        lines += [
            (f"the true model, {kind}", "", "", *_score_cells(known))
            for kind, known in self.truth.items()
        ]
        return (
            Table(
                title=f"fit: {_DEMONSTRATIONS} demonstrations x {_SAMPLES} samples x 6 "
                f"outputs, scored on {_HELD_OUT} others",
                columns=(
                    *("", "CPU ms [quartiles]", "ratio", "NLPD"),
                    *("within 1.96 std", "in stated 95 %"),
                ),
                rows=tuple(lines),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Speed and accuracy relative to hetGP, where it is installed."""
        targets = []
        for kind in _KINDS:
            ours, peer = self._row(_OURS, kind), self._row(_HETGPY, kind)
            if not (ours.time and peer.time and ours.score and peer.score):
                continue
            gap = abs(ours.score.coverage - 0.95) - abs(peer.score.coverage - 0.95)
            targets += [
                Target(
                    name=f"fit, {kind}: hetGP's time / ours",
                    value=peer.time.median / ours.time.median,
                    low=30.0,
                ),
                Target(
                    name=f"fit, {kind}: NLPD above hetGP's",
                    value=ours.score.nlpd - peer.score.nlpd,
                    high=0.0,
                ),
                Target(
                    name=f"fit, {kind}: coverage further from 0.95 than hetGP's",
                    value=gap,
                    high=0.0,
                ),
            ]
        return tuple(targets)

    def _row(self, library: str, kind: Deviations) -> FitRow:
        wanted = (library, kind)
        return next(r for r in self.rows if (r.library, r.deviations) == wanted)

    def _line(self, row: FitRow) -> tuple[str, ...]:
        name = f"{row.library}, {row.deviations}"
        ours = self._row(_OURS, row.deviations).time
        if row.time is None or ours is None or row.score is None:
            return (name, NOT_INSTALLED, *["-"] * 4)
        ratio = row.time.median / ours.median
        return (name, str(row.time), number(ratio, 1), *_score_cells(row.score))


def _score_cells(known: Score) -> tuple[str, str, str]:
    stated = number(known.interval_coverage)
    return number(known.nlpd), number(known.coverage), stated


def compare_fits(repeats: int, seed: int = 0) -> FitComparison:
    """Time and score every installed library.

    Args:
        repeats: Measurements of each.
        seed: Seed of the demonstrations.
    """
    process = KnownProcess.on_grid(_SAMPLES)
    rows: list[FitRow] = []
    truth: dict[str, Score] = {}
    for place, kind in enumerate(_KINDS):
        rng = np.random.default_rng((seed, place))
        given = process.demonstrations(_DEMONSTRATIONS, kind, rng)
        held_out = process.draw(_HELD_OUT, kind, rng)
        truth[kind] = score(held_out, process.mean, process.std)
        rows += _rows(kind, given, held_out, repeats)
    return FitComparison(rows=tuple(rows), truth=truth)


def _rows(
    kind: Deviations, given: AlignedDemonstrations, held_out: Array, repeats: int
) -> list[FitRow]:
    there = {name: fit for name, (module, fit) in _PEERS.items() if installed(module)}
    candidates = {_OURS: repeated(partial(fit_skill, given))} | {
        name: repeated(partial(fit, given.times, given.poses))
        for name, fit in there.items()
    }
    times = interleaved(candidates, repeats)
    predictions: dict[str, Prediction] = {_OURS: _ours(given)}
    for name, fit in there.items():
        predictions[name] = (*fit(given.times, given.poses), None)
    return [
        FitRow(
            library=name,
            deviations=kind,
            time=times.get(name),
            score=score(held_out, *predictions[name]) if name in times else None,
        )
        for name in (_OURS, *_PEERS)
    ]


def _ours(given: AlignedDemonstrations) -> Prediction:
    predicted = fit_skill(given).predict(given.times)
    return predicted.mean, predicted.std, predicted.interval(0.95)
