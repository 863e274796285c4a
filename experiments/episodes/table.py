"""Metrics as a table for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from experiments.episodes.metrics import EpisodeMetrics


def table(metrics: Sequence[EpisodeMetrics]) -> str:
    """The most telling measures as aligned text, one line per door."""

    def number(value: float | None, digits: int = 1, scale: float = 1.0) -> str:
        return "-" if value is None else f"{scale * value:.{digits}f}"

    rows = [
        (
            *("door", "radius", "opened", "angle", "to 30°", "to 60°"),
            *("tangential", "radial", "slip", "error", "decision"),
        ),
        ("", "m", "", "deg", "s", "s", "N peak", "N peak", "mm", "mm rms", "ms p95"),
    ]
    for one in metrics:
        error = one.prediction_error_position
        rows.append(
            (
                one.door,
                number(one.radius, 2),
                "yes" if one.success else one.failure.replace("_", " "),
                number(one.final_angle_deg),
                number(one.time_to_30_deg),
                number(one.time_to_60_deg),
                number(one.force_tangential_peak),
                number(one.force_radial_peak),
                number(one.slip_max_mm),
                number(None if error is None else error**0.5, scale=1e3),
                number(one.latency_p95_ms, 2),
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    )
    return "\n".join(lines)
