"""The parts of the benchmark by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from experiments.benchmarks.aligning import measure_alignment
from experiments.benchmarks.calibration import calibrate
from experiments.benchmarks.doors import forecast_doors
from experiments.benchmarks.elsewhere import quote_elsewhere
from experiments.benchmarks.fitting import compare_fits
from experiments.benchmarks.loops import measure_loops
from experiments.benchmarks.prediction import measure_prediction
from experiments.benchmarks.recording_cost import measure_recording
from experiments.benchmarks.report import Result
from experiments.benchmarks.resetting import measure_resets
from experiments.benchmarks.scaling import measure_scaling
from experiments.benchmarks.stepping import measure_stepping
from experiments.benchmarks.vectors import measure_vectors
from experiments.benchmarks.via_points import measure_via_points

__all__ = ["PARTS", "Part"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """One part of the benchmark."""

    measures: Mapping[str, Callable[[int], Result]]
    """What to run, by the name of its results; each takes the number of repeats."""
    needs: tuple[str, ...] = ()
    """Libraries (import names) it compares with."""


def _doors(repeats: int) -> Result:
    # The product's hundreds of refits make every draw cost a quarter of a minute.
    return forecast_doors(seeds=min(repeats, 2))


PARTS: Final[dict[str, Part]] = {
    "fit": Part(measures={"fit": compare_fits}, needs=("hetgpy", "sklearn")),
    "scaling": Part(measures={"scaling": measure_scaling}),
    "predict": Part(measures={"predict": measure_prediction}),
    "adapt": Part(measures={"adapt": measure_via_points}),
    "align": Part(measures={"align": measure_alignment}, needs=("dtw",)),
    "environment": Part(
        measures={
            "steps": measure_stepping,
            "resets": measure_resets,
            "vectors": measure_vectors,
            "loops": measure_loops,
            "recording": measure_recording,
            "elsewhere": quote_elsewhere,
        }
    ),
    "accuracy": Part(measures={"calibration": calibrate, "doors": _doors}),
}
"""In the order of the report."""
