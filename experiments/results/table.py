"""A study, and the doors of one run, as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from experiments.episodes.metrics import EpisodeMetrics
from experiments.files.table import Table
from experiments.results.grouping import by_policy, grouped
from experiments.results.measures import (
    EPISODE_MEASURES,
    PREDICTION_ERROR,
    Measure,
    number_text,
)
from experiments.results.records import EpisodeResult
from experiments.results.statistics import wilson_interval

_OF_SOLVED: Final = (
    Measure("time_to_60_deg", "to 60° [s]", digits=1),
    Measure("force_radial_peak", "radial force [N]", digits=1),
    Measure("force_tangential_peak", "tangential [N]", digits=1),
    Measure("slip_max_mm", "slip [mm]", digits=1),
)
_OF_ALL: Final = (
    PREDICTION_ERROR,
    Measure("governed_share", "governed [%]", digits=1, convert=lambda x: 100.0 * x),
    EPISODE_MEASURES["latency_median_ms"],
)


def error_count(episodes: Sequence[EpisodeResult]) -> str:
    """Say how many episodes ended in an error; "" if none did."""
    failed = [one for one in episodes if one.error]
    if not failed:
        return ""
    whose = ", ".join(f"{name} {len(own)}" for name, own in by_policy(failed).items())
    return (
        f"{len(failed)} of {len(episodes)} episodes ended in an error and count "
        f"neither as opened nor as closed: {whose}."
    )


def study_table(episodes: Iterable[EpisodeResult]) -> Table:
    """Return a row per policy and door, in the order in which they come.

    Rates are over the episodes that ran. Forces, slip and times are medians over the
    successes; the prediction error, the share of decisions in which the stability bound
    limited the stiffness, and the decision time are medians over all that ran.
    """
    groups = grouped(episodes, lambda one: (one.policy, one.task.door))
    measures = (*_OF_SOLVED, *_OF_ALL)
    return Table(
        columns=("policy", "door", "opened", "95 %", *(one.title for one in measures)),
        rows=tuple((*names, *_cells(own)) for names, own in groups.items()),
    )


def _cells(own: Sequence[EpisodeResult]) -> tuple[str, ...]:
    ran = [one for one in own if not one.error]
    solved = [one for one in ran if one.solved]
    low, high = wilson_interval(len(solved), len(ran)) if ran else (0.0, 1.0)
    return (
        f"{len(solved)}/{len(ran)}",
        f"{low:.2f}–{high:.2f}",
        *(measure.text(measure.median(solved)) for measure in _OF_SOLVED),
        *(measure.text(measure.median(ran)) for measure in _OF_ALL),
    )


def run_table(metrics: Iterable[EpisodeMetrics]) -> Table:
    """Return the most telling metrics of a run, a row per door."""

    def text(value: float | None, digits: int = 1, scale: float = 1.0) -> str:
        return "–" if value is None else number_text(scale * value, digits)

    rows = []
    for one in metrics:
        error = one.prediction_error_position
        rows.append(
            (
                one.door,
                text(one.radius, 2),
                "yes" if one.success else one.failure.replace("_", " "),
                text(one.final_angle_deg),
                text(one.time_to_30_deg),
                text(one.time_to_60_deg),
                text(one.force_tangential_peak),
                text(one.force_radial_peak),
                text(one.slip_max_mm),
                text(None if error is None else error**0.5, scale=1e3),
                text(one.latency_p95_ms, 2),
            )
        )
    columns = (
        "door",
        "radius\nm",
        "opened",
        "angle\ndeg",
        "to 30°\ns",
        "to 60°\ns",
        "tangential\nN peak",
        "radial\nN peak",
        "slip\nmm",
        "error\nmm rms",
        "decision\nms p95",
    )
    return Table(columns=columns, rows=tuple(rows))
