"""Doors that were not demonstrated, from their first centimetres.

Every radius in turn is left out of the demonstrations. The left-out opening is then
streamed as via-points, and after each the rest of it is predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.artificial import door_opening
from experiments.benchmarks.report import Table, Target, number
from experiments.benchmarks.scores import NORMAL_95
from experiments.teacher import Teacher
from policies.adaptation import ADAPTATIONS, Adaptation
from policies.aligned import AlignedDemonstrations
from policies.alignment import align
from policies.skill import Skill, fit_skill
from policies.trajectory import ViaPoint

__all__ = ["DoorForecasts", "DoorRow", "Forecast", "forecast_doors", "judge_form"]

Array = NDArray[np.float64]
Openings = tuple[AlignedDemonstrations, tuple[float, ...]]
"""All demonstrations on one clock, and the radius of each [m]."""

_PER_RADIUS = 2
_EVERY, _STD = 4, 1e-3
"""Via-points: every fourth sample, with a millimetre of noise."""
_SOON = 20
_PLANE = [0, 2]
"""x and z, which a door moves [m]."""
_FEW, _MANY = (0.30, 0.42, 0.53, 0.65), tuple(np.linspace(0.30, 0.65, 8).round(2))


@dataclass(frozen=True, kw_only=True, slots=True)
class Forecast:
    """Prediction of a stretch of a left-out opening, over all stages of it."""

    rmse: float
    """Root mean squared error in x and z [m]."""
    coverage: float
    """Share within mean ± 1.96 std."""
    interval_coverage: float
    """Share within the 95 % interval that the policy itself states."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorRow:
    """One form of adaptation on one set of doors."""

    doors: str
    """Which demonstrations."""
    form: str
    """Form of adaptation."""
    soon: Forecast
    """The next 20 of 200 samples after the last via-point."""
    rest: Forecast
    """Everything after the last via-point."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorForecasts:
    """All forms on all sets of doors."""

    rows: tuple[DoorRow, ...]
    """One per form and set."""

    def tables(self) -> tuple[Table, ...]:
        """One line per form and set."""
        return (
            Table(
                title="accuracy: left-out door radii 0.30 to 0.65 m, x and z, "
                f"via-points every {_EVERY}th of 200 samples",
                columns=(
                    *("", f"next {_SOON}: rmse mm", "within 1.96 std", "stated 95 %"),
                    *("rest: rmse mm", "within 1.96 std", "stated 95 %"),
                ),
                rows=tuple(
                    (f"{row.doors}, {row.form}", *_cells(row.soon), *_cells(row.rest))
                    for row in self.rows
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Accuracy of the default form, on every set of doors."""
        targets = []
        for row in self.rows:
            if row.form != "process":
                continue
            product = next(
                other.rest
                for other in self.rows
                if (other.doors, other.form) == (row.doors, "product")
            )
            name = f"accuracy, {row.doors}:"
            targets += [
                Target(
                    name=f"{name} rmse of the next {_SOON} [mm]",
                    value=1e3 * row.soon.rmse,
                    high=5.0,
                ),
                Target(
                    name=f"{name} rmse of the rest / product's",
                    value=row.rest.rmse / product.rmse,
                    high=0.6,
                ),
                *_coverage_targets(name, row),
            ]
        return tuple(targets)


def _coverage_targets(name: str, row: DoorRow) -> list[Target]:
    return [
        Target(
            name=f"{name} stated 95 % holds, {stretch}",
            value=forecast.interval_coverage,
            low=0.90,
            high=0.98,
        )
        for stretch, forecast in ((f"next {_SOON}", row.soon), ("rest", row.rest))
    ]


def _cells(forecast: Forecast) -> tuple[str, str, str]:
    return (
        number(1e3 * forecast.rmse, 2),
        number(forecast.coverage),
        number(forecast.interval_coverage),
    )


def forecast_doors(seeds: int = 2) -> DoorForecasts:
    """Leave every radius out once, in every set of demonstrations.

    Args:
        seeds: Number of draws of the demonstrations.
    """
    sets: dict[str, Callable[[np.random.Generator], Openings]] = {
        "3 of 4 radii": lambda rng: _arcs(_FEW, rng),
        "7 of 8 radii": lambda rng: _arcs(_MANY, rng),
        "3 of 4 radii, synthetic human": lambda rng: _teacher(_FEW, rng),
    }
    rows = []
    for name, draw in sets.items():
        openings = [draw(np.random.default_rng(seed)) for seed in range(seeds)]
        rows += [judge_form(name, form, openings) for form in ADAPTATIONS]
    return DoorForecasts(rows=tuple(rows))


def _arcs(radii: Sequence[float], rng: np.random.Generator) -> Openings:
    times = np.linspace(0.0, 1.0, 200)
    each = tuple(radius for radius in radii for _ in range(_PER_RADIUS))
    poses = np.stack([door_opening(radius, times, rng) for radius in each])
    return AlignedDemonstrations(times=times, poses=poses), each


def _teacher(radii: Sequence[float], rng: np.random.Generator) -> Openings:
    recorded = Teacher().demonstrate_doors(radii, _PER_RADIUS, rng=rng)
    return align(recorded), tuple(r for r in radii for _ in range(_PER_RADIUS))


def judge_form(doors: str, form: str, openings: Sequence[Openings]) -> DoorRow:
    """Leave every radius out of every draw and judge one form of adaptation.

    Args:
        doors: Name for the report.
        form: Name in `policies.adaptation.ADAPTATIONS`.
        openings: Draws of demonstrations.
    """
    stages = [
        stage
        for seed, (aligned, radii) in enumerate(openings)
        for radius in sorted(set(radii))
        for stage in _left_out(aligned, np.array(radii) == radius, form, seed)
    ]
    soon, rest = zip(*stages, strict=True)
    return DoorRow(doors=doors, form=form, soon=_pooled(soon), rest=_pooled(rest))


_Inside = NDArray[np.bool_]
_Stretch = tuple[Array, _Inside, _Inside]
"""Errors, and whether each is within 1.96 std and within the stated interval."""


def _left_out(
    aligned: AlignedDemonstrations, held_out: NDArray[np.bool_], form: str, seed: int
) -> Iterator[tuple[_Stretch, _Stretch]]:
    """Yield every stage of every held-out opening: what comes soon, and the rest."""
    skill = fit_skill(
        AlignedDemonstrations(times=aligned.times, poses=aligned.poses[~held_out])
    )
    rng = np.random.default_rng(seed)
    for opening in aligned.poses[held_out]:
        yield from _stream(skill, opening, form, rng)


def _stream(
    skill: Skill, opening: Array, form: str, rng: np.random.Generator
) -> Iterator[tuple[_Stretch, _Stretch]]:
    times = skill.aligned.times
    adaptation = ADAPTATIONS[form](skill, times)
    # From the second via-point, as long as there are samples enough after it.
    for stage, place in enumerate(range(0, len(times) - _SOON - _EVERY, _EVERY)):
        seen = opening[place] + _STD * rng.standard_normal(6)
        adaptation.observe(ViaPoint(phase=float(times[place]), pose=seen, std=_STD))
        if stage > 0:
            ahead = _judged(adaptation, opening, place + _EVERY)
            soon = (ahead[0][:_SOON], ahead[1][:_SOON], ahead[2][:_SOON])
            yield soon, ahead


def _judged(adaptation: Adaptation, opening: Array, start: int) -> _Stretch:
    predicted = adaptation.trajectory()
    low, high = predicted.interval(0.95)
    truth = opening[start:, _PLANE]
    error = truth - predicted.mean[start:, _PLANE]
    return (
        error,
        np.abs(error) <= NORMAL_95 * predicted.std[start:, _PLANE],
        (truth >= low[start:, _PLANE]) & (truth <= high[start:, _PLANE]),
    )


def _pooled(stretches: Sequence[_Stretch]) -> Forecast:
    """Average over stages, so that early ones, with a longer rest, do not dominate."""
    errors, normal, stated = zip(*stretches, strict=True)
    squared = float(np.mean([np.mean(error**2) for error in errors]))
    return Forecast(
        rmse=squared**0.5,
        coverage=float(np.mean([inside.mean() for inside in normal])),
        interval_coverage=float(np.mean([inside.mean() for inside in stated])),
    )
