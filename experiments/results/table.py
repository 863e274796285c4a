"""A study in a table: one row per policy and door, with its uncertainty."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

COLUMNS = (
    *("policy", "door", "opened", "95 %", "to 60° [s]", "radial force [N]"),
    *("tangential [N]", "slip [mm]", "√E[ε²] [mm]", "governed [%]", "decision [ms]"),
)
"""Heads of the table."""


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the Wilson score interval of a success rate at 95 %.

    Args:
        successes: Number of successes, 0 to ``trials``.
        trials: Number of trials, at least 1.
    """
    z = 1.959963984540054
    rate = successes / trials
    scale = 1.0 + z * z / trials
    middle = (rate + z * z / (2 * trials)) / scale
    spread = rate * (1.0 - rate) / trials + (z / (2 * trials)) ** 2
    half = z / scale * math.sqrt(spread)
    return max(0.0, middle - half), min(1.0, middle + half)


def summary_table(results: Iterable[Mapping[str, Any]]) -> str:
    """Return a Markdown table of a study.

    Forces, slip and times are medians over the successes; the prediction error, the
    share of decisions in which the stability bound limited the stiffness, and the
    decision time are medians over all episodes.

    Args:
        results: What `experiments.study.runner.run_study` yields.
    """
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for result in results:
        key = (result["task"]["policy"], result["task"]["door"])
        groups.setdefault(key, []).append(result)
    rows = [_row(*key, group) for key, group in groups.items()]
    lines = [list(COLUMNS), ["---"] * len(COLUMNS), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _row(policy: str, door: str, group: Sequence[Mapping[str, Any]]) -> list[str]:
    episodes = [result["metrics"] for result in group if "metrics" in result]
    opened = [episode for episode in episodes if episode["success"]]
    low, high = wilson_interval(len(opened), len(group))
    error = _median(episodes, "prediction_error_position")
    governed = _median(episodes, "governed_share")
    return [
        policy,
        door,
        f"{len(opened)}/{len(group)}",
        f"{low:.2f}–{high:.2f}",
        _text(_median(opened, "time_to_60_deg"), 1),
        _text(_median(opened, "force_radial_peak"), 1),
        _text(_median(opened, "force_tangential_peak"), 1),
        _text(_median(opened, "slip_max_mm"), 1),
        _text(None if error is None else 1e3 * math.sqrt(error), 1),
        _text(None if governed is None else 100.0 * governed, 1),
        _text(_median(episodes, "latency_median_ms"), 2),
    ]


def _median(episodes: Sequence[Mapping[str, Any]], name: str) -> float | None:
    values = [episode[name] for episode in episodes if episode[name] is not None]
    return statistics.median(values) if values else None


def _text(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
