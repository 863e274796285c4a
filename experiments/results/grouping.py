"""Results grouped once: by condition, policy, kind of door and door."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from experiments.results.measures import EPISODE_MEASURES, Measure
from experiments.results.records import KINDS, EpisodeResult, TaskResult
from experiments.study.settings import Condition
from gplfd_env.randomization import RANDOMIZATIONS

ResultT = TypeVar("ResultT", bound=TaskResult)

Runs = Mapping[str, Sequence[EpisodeResult]]
"""Episodes by the name of their policy."""

_BAND: Final = 0.1
"""Width of a band of radii that are drawn at random [m]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """The episodes of one condition, in the groups in which they are compared.

    Episodes that ended in an error are in `failed` alone: neither opened nor closed.
    """

    condition: Condition
    """What they have in common."""
    runs: Runs
    """Those that ran, by policy: who opens most comes first, then who is gentlest."""
    failed: Runs
    """Those that ended in an error, by policy."""
    kinds: Mapping[str, Runs]
    """Those that ran by kind of door."""
    doors: Mapping[str, Runs]
    """Those that ran by door, from small to large.

    Where radii are drawn at random, a door's name says little: they are put together in
    bands of 0.1 m.
    """


def comparisons(episodes: Iterable[EpisodeResult]) -> list[Comparison]:
    """Return the conditions of a study, the one with most episodes first."""
    return [_comparison(own) for own in by_condition(episodes).values()]


def _comparison(episodes: Sequence[EpisodeResult]) -> Comparison:
    ran = sorted(
        (one for one in episodes if not one.error),
        key=lambda one: (one.radius, one.task.door),
    )
    kinds = grouped(ran, lambda one: one.kind)
    drawn = any(one.drawn for one in ran)
    doors = grouped(ran, _band if drawn else _door)
    return Comparison(
        condition=episodes[0].condition,
        runs=ranked(episodes),
        failed=by_policy(one for one in episodes if one.error),
        kinds={kind: by_policy(kinds[kind]) for kind in KINDS if kind in kinds},
        doors={door: by_policy(own) for door, own in doors.items()},
    )


def ranked(episodes: Iterable[EpisodeResult]) -> Runs:
    """Return episodes that ran by policy: who opens most first, then the gentlest.

    A policy whose episodes all ended in an error comes last, without any.
    """
    runs = {
        policy: [one for one in own if not one.error]
        for policy, own in by_policy(episodes).items()
    }
    return dict(sorted(runs.items(), key=_rank))


def _rank(item: tuple[str, Sequence[EpisodeResult]]) -> tuple[float, float, str]:
    policy, own = item
    rate = sum(one.opened() for one in own) / len(own) if own else -1.0
    force = EPISODE_MEASURES["force_radial_peak"].median(own)
    return -rate, math.inf if force is None else force, policy


def _band(one: EpisodeResult) -> str:
    low = _BAND * math.floor(one.radius / _BAND + 1e-9)
    return f"{low:.1f}–{low + _BAND:.1f} m"


def _door(one: EpisodeResult) -> str:
    try:
        float(one.task.door)
    except ValueError:
        return f"{one.task.door} {one.radius:g}"
    return one.task.door


def by_policy(results: Iterable[ResultT]) -> dict[str, list[ResultT]]:
    """Return results by the name of their policy."""
    return grouped(results, lambda one: one.policy)


def by_condition(results: Iterable[ResultT]) -> dict[Condition, list[ResultT]]:
    """Return results by what they share, those with most results first."""
    groups = grouped(results, lambda one: one.condition)
    standing = {name: place for place, name in enumerate(RANDOMIZATIONS)}

    def order(item: tuple[Condition, Sequence[ResultT]]) -> tuple[float, ...]:
        condition, own = item
        return (
            -len(own),
            standing[condition.randomization],
            abs(condition.teacher_noise - 1.0),
            condition.teacher_noise,
            abs(condition.demonstrations_per_door - 2),
            condition.demonstrations_per_door,
        )

    return dict(sorted(groups.items(), key=order))


GroupT = TypeVar("GroupT")


def grouped(
    results: Iterable[ResultT], group: Callable[[ResultT], GroupT]
) -> dict[GroupT, list[ResultT]]:
    """Return results by a group that each has, in the order in which groups come."""
    groups: dict[GroupT, list[ResultT]] = {}
    for one in results:
        groups.setdefault(group(one), []).append(one)
    return groups


def numbers(
    runs: Mapping[str, Iterable[TaskResult]], measure: Measure
) -> dict[str, dict[str, float]]:
    """Return a measure by policy and task; tasks without it are left out."""
    return {
        policy: {
            one.pair: value for one in own if (value := measure.of(one)) is not None
        }
        for policy, own in runs.items()
    }


def difference(condition: Condition, standard: Condition) -> str:
    """Say in what a condition differs from another, in few words."""
    parts = []
    if condition.randomization != standard.randomization:
        parts.append(f"{condition.randomization} randomization")
    if condition.teacher_noise != standard.teacher_noise:
        parts.append(f"teacher noise × {condition.teacher_noise:g}")
    if condition.demonstrations_per_door != standard.demonstrations_per_door:
        parts.append(f"{condition.demonstrations_per_door} demonstrations per door")
    return ", ".join(parts)
