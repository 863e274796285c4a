"""Taking in one via-point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.benchmarks.artificial import KnownProcess
from experiments.benchmarks.report import Table, Target, number
from experiments.benchmarks.timing import Action, Candidate, CpuTime, interleaved
from policies.adaptation import ADAPTATIONS, AdaptationForm
from policies.skill import Skill, fit_skill
from policies.trajectory import ViaPoint

__all__ = ["ViaPointTimes", "measure_via_points"]

_GRID = np.linspace(0.0, 1.0, 200)
_IN_A_ROW = 10


@dataclass(frozen=True, kw_only=True, slots=True)
class ViaPointTimes:
    """One via-point on six outputs, mean and standard deviation read afterwards."""

    update: Mapping[str, CpuTime]
    """Per via-point, by form of adaptation."""
    start: Mapping[str, CpuTime]
    """Building the adaptation before the first via-point, by form."""

    def tables(self) -> tuple[Table, ...]:
        """One line per form."""
        reference = self.update["process"].median
        return (
            Table(
                title=f"adapt: one via-point of {_IN_A_ROW} in a row, six outputs, "
                f"{len(_GRID)} phases",
                columns=(
                    *("", "CPU ms [quartiles]", "ratio"),
                    "before the first [ms]",
                ),
                rows=tuple(
                    (
                        form,
                        str(time),
                        number(time.median / reference, 1),
                        str(self.start[form]),
                    )
                    for form, time in self.update.items()
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Cheap enough for every control step, and cheaper than the product."""
        process, product = self.update["process"], self.update["product"]
        return (
            Target(
                name="adapt: one via-point [ms]",
                value=1e3 * process.median,
                high=0.2,
            ),
            Target(
                name="adapt: product's time / process's",
                value=product.median / process.median,
                low=15.0,
            ),
        )


def measure_via_points(repeats: int, seed: int = 0) -> ViaPointTimes:
    """Time every form of adaptation.

    Args:
        repeats: Measurements of each.
        seed: Seed of demonstrations and via-points.
    """
    rng = np.random.default_rng(seed)
    process = KnownProcess.on_grid(len(_GRID))
    skill = fit_skill(process.demonstrations(6, "smooth", rng))
    skill.deviations  # noqa: B018  (made on first use; belongs to learning)
    path = process.draw(1, "smooth", rng)[0]
    points = [
        ViaPoint(phase=float(_GRID[place]), pose=path[place])
        for place in range(0, 4 * _IN_A_ROW, 4)
    ]
    updates = {
        form: Candidate(
            prepare=partial(_updating, build, skill, points), operations=_IN_A_ROW
        )
        for form, build in ADAPTATIONS.items()
    }
    starts = {
        form: Candidate(prepare=partial(partial, build, skill, _GRID))
        for form, build in ADAPTATIONS.items()
    }
    return ViaPointTimes(
        update=interleaved(updates, repeats), start=interleaved(starts, repeats)
    )


def _updating(build: AdaptationForm, skill: Skill, points: list[ViaPoint]) -> Action:
    adaptation = build(skill, _GRID)

    def update() -> None:
        for point in points:
            adaptation.observe(point)
            _ = adaptation.mean, adaptation.std

    return update
