"""Results grouped by condition, policy, kind of door and door."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Final, TypeVar

from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES, Measure
from gplfd_experiments.analysis.results.records import (
    EpisodeResult,
    TaskResult,
    TaughtResult,
)
from gplfd_experiments.analysis.results.statistics import Key
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.studies.settings import Condition

ResultT = TypeVar("ResultT", bound=TaskResult)
TaughtT = TypeVar("TaughtT", bound=TaughtResult)
GroupT = TypeVar("GroupT")

Runs = Mapping[str, Sequence[EpisodeResult]]
"""Episodes by the name of their policy."""

_BAND: Final = 0.1
"""Width of a band of radii that are drawn at random [m]."""


def grouped(
    results: Iterable[ResultT], group: Callable[[ResultT], GroupT]
) -> dict[GroupT, list[ResultT]]:
    """Return results by a group that each has, in the order in which groups come."""
    groups: dict[GroupT, list[ResultT]] = {}
    for one in results:
        groups.setdefault(group(one), []).append(one)
    return groups


def by_policy(results: Iterable[ResultT]) -> dict[str, list[ResultT]]:
    """Return results by the name of their policy."""
    return grouped(results, attrgetter("policy"))


def by_door_kind(episodes: Iterable[EpisodeResult]) -> dict[str, list[EpisodeResult]]:
    """Return episodes by kind of door, the kinds in the order in which they come."""
    return grouped(episodes, attrgetter("door_kind"))


def by_condition(results: Iterable[TaughtT]) -> dict[Condition, list[TaughtT]]:
    """Return results by what they share, those with most results first."""
    known = [*RANDOMIZATIONS]

    def order(item: tuple[Condition, Sequence[TaughtT]]) -> tuple[float, ...]:
        condition, own = item
        name = condition.randomization
        return (
            -len(own),
            known.index(name) if name in known else len(known),
            abs(condition.teacher_noise - 1.0),
            condition.teacher_noise,
            abs(condition.demonstrations_per_door - 2),
            condition.demonstrations_per_door,
        )

    return dict(sorted(grouped(results, lambda one: one.condition).items(), key=order))


def ranked(episodes: Iterable[EpisodeResult]) -> Runs:
    """Return episodes by policy, ordered by doors opened, then by radial force."""

    def order(item: tuple[str, Sequence[EpisodeResult]]) -> tuple[float, float, str]:
        policy, own = item
        known = [one for one in own if one.counts]
        rate = sum(one.opened() for one in known) / len(known) if known else -1.0
        force = EPISODE_MEASURES["force_radial_peak"].median(known)
        return -rate, math.inf if force is None else force, policy

    return dict(sorted(by_policy(episodes).items(), key=order))


def counted(results: Mapping[str, Sequence[ResultT]]) -> dict[str, list[ResultT]]:
    """Return by policy the results that count, as `TaskResult.counts` says."""
    return {
        policy: [one for one in own if one.counts] for policy, own in results.items()
    }


def of_split(runs: Runs, split: str) -> Runs:
    """Return the episodes of one of `records.SPLITS`, by policy."""
    return {
        policy: [one for one in own if one.split == split]
        for policy, own in runs.items()
    }


def numbers(
    runs: Mapping[str, Iterable[TaskResult]], measure: Measure
) -> dict[str, dict[Key, float]]:
    """Return a measure by policy and task; tasks without it are left out."""
    return {
        policy: {
            one.key: value for one in own if (value := measure.of(one)) is not None
        }
        for policy, own in runs.items()
    }


def door_name(one: EpisodeResult) -> str:
    """Return the name of a door, with its radius; drawn radii are named by a band."""
    if one.drawn:
        low = _BAND * math.floor(one.radius / _BAND + 1e-9)
        return f"{low:.1f}–{low + _BAND:.1f} m"
    try:
        float(one.task.door)
    except ValueError:
        return f"{one.task.door} {one.radius:g}"
    return one.task.door


def closed_because(episodes: Iterable[EpisodeResult]) -> str:
    """Count why doors stayed closed, the most frequent reason first."""
    reasons = Counter(
        why_closed(one.metrics["failure"], one.metrics.get("reason", ""))
        for one in episodes
        if one.counts and not one.solved
    )
    order = sorted(reasons.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{count} × {reason}" for reason, count in order)
