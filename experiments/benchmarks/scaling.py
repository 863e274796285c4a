"""Learning more and longer demonstrations."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.benchmarks.artificial import KnownProcess
from experiments.benchmarks.report import Table, Target
from experiments.benchmarks.timing import CpuTime, interleaved, repeated
from policies.aligned import AlignedDemonstrations
from policies.skill import fit_skill

__all__ = ["Scaling", "ScalingRow", "log_log_slopes", "measure_scaling"]

_COUNTS, _SAMPLES = (2, 6, 20, 100), (100, 200, 400, 1000)


@dataclass(frozen=True, kw_only=True, slots=True)
class ScalingRow:
    """One size of problem."""

    demonstrations: int
    """Number of demonstrations D."""
    samples: int
    """Samples M of each."""
    time: CpuTime
    """CPU time to learn all six outputs."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Scaling:
    """Learning time over numbers and lengths of demonstrations."""

    rows: tuple[ScalingRow, ...]
    """All combinations."""
    slope_in_demonstrations: float
    """Exponent of D in the learning time."""
    slope_in_samples: float
    """Exponent of M."""
    growth: float
    """Time of the largest problem over that of 6 × 200."""

    def tables(self) -> tuple[Table, ...]:
        """Medians, demonstrations down and samples across."""
        cells = {(row.demonstrations, row.samples): str(row.time) for row in self.rows}
        counts = sorted({count for count, _ in cells})
        samples = sorted({size for _, size in cells})
        return (
            Table(
                title="scaling: fit of six outputs, CPU ms [quartiles]; exponent of "
                f"the time {self.slope_in_demonstrations:.3f} in demonstrations, "
                f"{self.slope_in_samples:.3f} in samples",
                columns=("demonstrations", *(f"{size} samples" for size in samples)),
                rows=tuple(
                    (str(count), *(cells[count, size] for size in samples))
                    for count in counts
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Nearly constant time."""
        return (
            Target(
                name="scaling: fit of 100 x 1000 / fit of 6 x 200",
                value=self.growth,
                high=2.0,
            ),
            Target(
                name="scaling: exponent in demonstrations",
                value=self.slope_in_demonstrations,
                high=0.15,
            ),
            Target(
                name="scaling: exponent in samples",
                value=self.slope_in_samples,
                high=0.15,
            ),
        )


def log_log_slopes(
    sizes: Sequence[tuple[int, int]], seconds: Sequence[float]
) -> tuple[float, float]:
    """Exponents a and b of seconds ≈ c · D^a · M^b, by least squares of logarithms.

    Args:
        sizes: Pairs (D, M), of at least two different D and two different M.
        seconds: Time for each.
    """
    logs = np.log(np.asarray(sizes, dtype=np.float64))
    design = np.column_stack([logs, np.ones(len(logs))])
    (a, b, _), *_ = np.linalg.lstsq(design, np.log(seconds), rcond=None)
    return float(a), float(b)


def measure_scaling(repeats: int, seed: int = 0) -> Scaling:
    """Time learning over all sizes.

    Args:
        repeats: Measurements of each size.
        seed: Seed of the demonstrations.
    """
    rng = np.random.default_rng(seed)
    sizes = list(itertools.product(_COUNTS, _SAMPLES))
    candidates = {
        f"{count} x {samples}": repeated(
            _learning(
                KnownProcess.on_grid(samples).demonstrations(count, "independent", rng)
            )
        )
        for count, samples in sizes
    }
    with warnings.catch_warnings():
        # Two demonstrations are few, and `fit_skill` says so.
        warnings.simplefilter("ignore", UserWarning)
        times = interleaved(candidates, repeats)
    medians = [time.median for time in times.values()]
    slopes = log_log_slopes(sizes, medians)
    return Scaling(
        rows=tuple(
            ScalingRow(demonstrations=count, samples=samples, time=time)
            for (count, samples), time in zip(sizes, times.values(), strict=True)
        ),
        slope_in_demonstrations=slopes[0],
        slope_in_samples=slopes[1],
        growth=times["100 x 1000"].median / times["6 x 200"].median,
    )


def _learning(given: AlignedDemonstrations) -> Callable[[], object]:
    return partial(fit_skill, given)
