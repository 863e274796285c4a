"""What of an episode or a learning test is compared, by name."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from experiments.results.records import Outcome

ADA_FORCE: Final = 22.2
"""Largest force that opens an interior hinged door, 5 lbf, by section 404.2.9 of the
ADA Standards for Accessible Design [N]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Measure:
    """A number of an outcome; less is better."""

    title: str
    """Name with unit, for the head of a column."""
    phrase: str
    """Name in a sentence."""
    unit: str
    """Unit; "" for none."""
    digits: int
    """Decimals that are shown."""
    of: Callable[[Outcome], float | None]
    """The number; None where there is none."""

    def text(self, value: float | None, *, unit: bool = False, finer: int = 0) -> str:
        """Write a value of this measure, or a dash.

        Args:
            value: The value.
            unit: Whether to add the unit.
            finer: How many more decimals than usual to show.
        """
        if value is None:
            return "–"
        number = number_text(value, self.digits + finer)
        gap = "" if self.unit == "°" else " "
        return f"{number}{gap}{self.unit}".rstrip() if unit else number


def number_text(value: float, digits: int, *, signed: bool = False) -> str:
    """Write a number with a typographic minus, and zero without a sign."""
    # Adding zero turns minus zero into zero.
    rounded = round(value, digits) + 0.0
    plus = "+" if signed and rounded != 0.0 else ""
    return f"{rounded:{plus}.{digits}f}".replace("-", "−")


def median(values: Iterable[float | None]) -> float | None:
    """Return the median of what is there; None for nothing."""
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def _metric(name: str, scale: float = 1.0) -> Callable[[Outcome], float | None]:
    def read(outcome: Outcome) -> float | None:
        value = outcome.number(name)
        return None if value is None else scale * value

    return read


def _when_opened(name: str, scale: float = 1.0) -> Callable[[Outcome], float | None]:
    """A metric of an opened door; a policy that lets go feels no force."""
    read = _metric(name, scale)

    def of(outcome: Outcome) -> float | None:
        opened = outcome.number("time_to_60_deg") is not None
        return read(outcome) if opened else None

    return of


def _prediction_error(outcome: Outcome) -> float | None:
    squared = outcome.number("prediction_error_position")
    return None if squared is None else 1e3 * math.sqrt(squared)


def _measure(
    title: str,
    phrase: str,
    unit: str,
    digits: int,
    of: Callable[[Outcome], float | None],
) -> Measure:
    return Measure(title=title, phrase=phrase, unit=unit, digits=digits, of=of)


EPISODE_MEASURES: Final[Mapping[str, Measure]] = {
    "time_30": _measure("to 30° [s]", "time to 30°", "s", 2, _metric("time_to_30_deg")),
    "time_60": _measure("to 60° [s]", "time to 60°", "s", 2, _metric("time_to_60_deg")),
    "tangential": _measure(
        "tangential peak [N]",
        "peak tangential force",
        "N",
        1,
        _when_opened("force_tangential_peak"),
    ),
    "tangential_p95": _measure(
        "tangential p95 [N]",
        "95th percentile of the tangential force",
        "N",
        1,
        _when_opened("force_tangential_p95"),
    ),
    "radial": _measure(
        "radial peak [N]",
        "peak radial force",
        "N",
        1,
        _when_opened("force_radial_peak"),
    ),
    "radial_p95": _measure(
        "radial p95 [N]",
        "95th percentile of the radial force",
        "N",
        1,
        _when_opened("force_radial_p95"),
    ),
    "slip": _measure(
        "slip [mm]", "slip in the hand", "mm", 1, _when_opened("slip_max_mm")
    ),
    "work": _measure("work [J]", "work on the door", "J", 2, _when_opened("work")),
    "error": _measure(
        "√E[ε²] [mm]", "prediction error √E[ε²]", "mm", 1, _prediction_error
    ),
    "margin": _measure(
        "stability margin [N/(m s)]",
        "smallest margin to the stability bound",
        "N/(m s)",
        0,
        _metric("stability_margin_translation"),
    ),
    "decision": _measure(
        "decision [ms]",
        "CPU time of a decision",
        "ms",
        2,
        _metric("latency_median_ms"),
    ),
}
"""Measures of episodes."""

SKILL_MEASURES: Final[Mapping[str, Measure]] = {
    "rmse_position": _measure(
        "position [mm]",
        "error of the predicted position",
        "mm",
        1,
        _metric("rmse_position_m", 1e3),
    ),
    "rmse_rotation": _measure(
        "rotation [°]",
        "error of the predicted rotation",
        "°",
        2,
        _metric("rmse_rotation_rad", math.degrees(1.0)),
    ),
    "nlpd": _measure("NLPD", "negative log predictive density", "", 2, _metric("nlpd")),
    "coverage_50": _measure(
        "inside 50 %", "share inside 50 %", "", 2, _metric("coverage_50")
    ),
    "coverage_90": _measure(
        "inside 90 %", "share inside 90 %", "", 2, _metric("coverage_90")
    ),
    "coverage_95": _measure(
        "inside 95 %", "share inside 95 %", "", 2, _metric("coverage_95")
    ),
    "via_position": _measure(
        "via-point [mm]",
        "error at a via-point",
        "mm",
        2,
        _metric("via_error_position_m", 1e3),
    ),
    "via_far": _measure(
        "far change [σ]", "change far from it", "σ", 2, _metric("via_far_change")
    ),
    "jerk": _measure(
        "−log jerk", "roughness", "", 2, _metric("log_dimensionless_jerk", -1.0)
    ),
    "fit": _measure("fit [s]", "CPU time to learn", "s", 2, _metric("cpu_fit_s")),
    "predict": _measure(
        "predict [ms]", "CPU time to predict", "ms", 2, _metric("cpu_predict_s", 1e3)
    ),
    "adapt": _measure(
        "adapt [ms]", "CPU time to adapt", "ms", 2, _metric("cpu_adapt_s", 1e3)
    ),
}
"""Measures of learning tests."""

HEADLINES: Final = ("radial", "tangential", "time_60", "slip", "error", "decision")
"""Episode measures that get a sentence."""
SKILL_HEADLINES: Final = ("nlpd", "rmse_position", "rmse_rotation")
"""Measures of learning tests that get a sentence."""
TESTED: Final = ("radial", "radial_p95", "tangential", "tangential_p95", "time_60")
"""Episode measures that get a paired test."""
