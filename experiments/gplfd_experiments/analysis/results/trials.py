"""What trials answer: numbers per seed, and what is lost without an idea."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from gplfd_experiments.analysis.results.records import EpisodeResult
from gplfd_experiments.analysis.results.statistics import (
    Key,
    Rate,
    Shift,
    mean_shift,
    paired,
    shift,
    success_rate,
)
from gplfd_experiments.studies.trials.records import MEASURES, Contrast, Side, value_of

SHARES: Final = frozenset({"success", "grasp_kept"})
"""Measures that are shares of episodes."""

Verdict = Literal["shows", "harms", "open"]
"""An idea helps, it does harm, or nothing could be shown."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Answer:
    """What a contrast came to."""

    contrast: Contrast
    """What was asked."""
    shift: Shift | None
    """The measure with the idea minus without it; None where both lack numbers."""

    @property
    def verdict(self) -> Verdict:
        """Whether the interval of the difference leaves zero out, and on which side."""
        if self.shift is None:
            return "open"
        _, better = MEASURES[self.contrast.measure]
        low, high = self.shift.low, self.shift.high
        if better == "less":
            low, high = -high, -low
        return "shows" if low > 0.0 else "harms" if high < 0.0 else "open"


def of_trial(
    episodes: Iterable[EpisodeResult], trial: str
) -> dict[str, dict[str, list[EpisodeResult]]]:
    """Return the episodes of a trial by policy and level, errors included."""
    found: dict[str, dict[str, list[EpisodeResult]]] = {}
    for one in episodes:
        if one.task.trial == trial:
            levels = found.setdefault(one.policy, {})
            levels.setdefault(one.task.level, []).append(one)
    return found


def answered(
    contrast: Contrast, episodes: Mapping[str, Mapping[str, Sequence[EpisodeResult]]]
) -> Answer:
    """Compare both sides of a contrast, seed by seed.

    Args:
        contrast: What is asked.
        episodes: Of its trial, by policy and level.
    """
    having, lacking = (
        _numbers(episodes, side, contrast.measure)
        for side in (contrast.having, contrast.lacking)
    )
    pairs = paired(having, lacking)
    if not pairs.seeds:
        return Answer(contrast=contrast, shift=None)
    estimate = mean_shift if contrast.measure in SHARES else shift
    return Answer(contrast=contrast, shift=estimate(*pairs.per_seed()))


def _numbers(
    episodes: Mapping[str, Mapping[str, Sequence[EpisodeResult]]],
    side: Side,
    measure: str,
) -> dict[Key, float]:
    """Return a measure by seed and door; by level, too, where levels are together."""
    found: dict[Key, float] = {}
    for level, own in episodes.get(side.policy, {}).items():
        if side.level not in ("", level):
            continue
        for one in own:
            value = value_of(one.metrics, measure) if one.counts else None
            if value is not None:
                # Levels that are compared with each other open the same doors.
                within = "" if side.level else level
                found[one.task.seed, f"{within} {one.task.door}"] = value
    return found


def summary(episodes: Sequence[EpisodeResult], measure: str) -> Rate | Shift | None:
    """Return a rate, or the typical value of a seed with its 95 % interval.

    Args:
        episodes: Of a policy at a level of a trial.
        measure: One of `MEASURES`.
    """
    if measure in SHARES:
        outcomes = _by_seed(episodes, measure).items()
        rate = success_rate((seed, bool(one)) for seed, own in outcomes for one in own)
        return rate if rate.trials else None
    means = seed_means(episodes, measure)
    return shift(means, [0.0] * len(means)) if means else None


def seed_means(episodes: Sequence[EpisodeResult], measure: str) -> list[float]:
    """Return the mean of a measure over each seed's episodes that have it.

    Args:
        episodes: Of a policy at a level of a trial.
        measure: One of `MEASURES`.
    """
    by_seed = _by_seed(episodes, measure).values()
    return [math.fsum(own) / len(own) for own in by_seed]


def _by_seed(episodes: Iterable[EpisodeResult], measure: str) -> dict[int, list[float]]:
    values: dict[int, list[float]] = {}
    for one in episodes:
        value = value_of(one.metrics, measure) if one.counts else None
        if value is not None:
            values.setdefault(one.task.seed, []).append(value)
    return values
