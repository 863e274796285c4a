"""Asking a learned skill."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.benchmarks.artificial import KnownProcess
from experiments.benchmarks.report import Table, Target
from experiments.benchmarks.timing import (
    Action,
    Candidate,
    CpuTime,
    interleaved,
    repeated,
)
from policies.skill import fit_skill

__all__ = ["Prediction", "measure_prediction"]

_OPERATIONS = 50


@dataclass(frozen=True, kw_only=True, slots=True)
class Prediction:
    """Mean, standard deviation and both their rates of six outputs."""

    at_200: CpuTime
    """`Skill.predict` at 200 phases."""
    at_1: CpuTime
    """At one phase."""
    first: CpuTime
    """The first prediction of a skill, at 200 phases, which makes its tables."""

    def tables(self) -> tuple[Table, ...]:
        """Three lines."""
        return (
            Table(
                title="predict: mean, standard deviation and both rates, six outputs",
                columns=("", "CPU ms [quartiles]"),
                rows=(
                    ("200 phases", str(self.at_200)),
                    ("1 phase", str(self.at_1)),
                    ("200 phases, first time", str(self.first)),
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Fast enough for every control step."""
        return (
            Target(
                name="predict: 200 phases [ms]",
                value=1e3 * self.at_200.median,
                high=0.5,
            ),
        )


def measure_prediction(repeats: int, seed: int = 0) -> Prediction:
    """Time predictions.

    Args:
        repeats: Measurements of each.
        seed: Seed of the demonstrations.
    """
    rng = np.random.default_rng(seed)
    given = KnownProcess.on_grid(200).demonstrations(6, "smooth", rng)
    skill = fit_skill(given)
    grid = np.linspace(0.0, 1.0, 200)

    def fresh() -> Action:
        return partial(fit_skill(given).predict, grid)

    times = interleaved(
        {
            "200": repeated(partial(skill.predict, grid), _OPERATIONS),
            "1": repeated(partial(skill.predict, grid[100:101]), _OPERATIONS),
            "first": Candidate(prepare=fresh),
        },
        repeats,
    )
    return Prediction(at_200=times["200"], at_1=times["1"], first=times["first"])
