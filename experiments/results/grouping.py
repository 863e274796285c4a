"""Episodes put together: by policy, by kind of door, by door, by condition."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, TypeVar

from experiments.results.measures import EPISODE_MEASURES, median
from experiments.results.records import Episode, Outcome
from experiments.study.settings import Condition
from gplfd_env.randomization import RANDOMIZATIONS

OutcomeT = TypeVar("OutcomeT", bound=Outcome)

DEMONSTRATED, UNDEMONSTRATED = "demonstrated radii", "undemonstrated radii"
HARDER: Final = "other hinges"
"""Doors of which the teacher has opened none: more friction, a closer, more mass."""

_BAND: Final = 0.1
"""Width of a band of radii that are drawn at random [m]."""


def by_policy(outcomes: Iterable[OutcomeT]) -> dict[str, list[OutcomeT]]:
    """Return outcomes by the name of their policy."""
    return _by(outcomes, lambda one: one.policy)


def by_pair(
    outcomes: Iterable[OutcomeT], of: Callable[[OutcomeT], float | None]
) -> dict[str, float]:
    """Return a number by task; tasks without it are left out."""
    numbers = {one.pair: of(one) for one in outcomes}
    return {pair: number for pair, number in numbers.items() if number is not None}


def by_condition(episodes: Iterable[OutcomeT]) -> dict[Condition, list[OutcomeT]]:
    """Return outcomes by what they share, those with most outcomes first."""
    groups: dict[Condition, list[OutcomeT]] = {}
    for one in episodes:
        groups.setdefault(one.condition, []).append(one)
    counts = Counter({condition: len(group) for condition, group in groups.items()})
    order = sorted(groups, key=lambda each: (-counts[each], *_rank(each)))
    return {condition: groups[condition] for condition in order}


def _rank(condition: Condition) -> tuple[float, ...]:
    """How far a condition is from the standard study's."""
    names = list(RANDOMIZATIONS)
    known = condition.randomization in names
    return (
        names.index(condition.randomization) if known else len(names),
        abs(condition.teacher_noise - 1.0),
        condition.teacher_noise,
        abs(condition.demonstrations_per_door - 2),
        condition.demonstrations_per_door,
    )


def difference(condition: Condition, standard: Condition) -> str:
    """Say in what a condition differs from another, in few words."""
    told = []
    if condition.randomization != standard.randomization:
        told.append(f"{condition.randomization} randomization")
    if condition.teacher_noise != standard.teacher_noise:
        told.append(f"teacher noise × {condition.teacher_noise:g}")
    if condition.demonstrations_per_door != standard.demonstrations_per_door:
        told.append(f"{condition.demonstrations_per_door} demonstrations per door")
    return ", ".join(told)


def kinds(episodes: Sequence[Episode]) -> dict[str, list[Episode]]:
    """Return episodes by kind of door; kinds without any are left out."""

    def kind(one: Episode) -> str:
        if not one.ordinary:
            return HARDER
        return DEMONSTRATED if one.demonstrated else UNDEMONSTRATED

    found = _by(episodes, kind)
    order = (DEMONSTRATED, UNDEMONSTRATED, HARDER)
    return {name: found[name] for name in order if name in found}


def places(episodes: Sequence[Episode]) -> dict[str, list[Episode]]:
    """Return episodes by door, from small to large.

    Where radii are drawn at random, a door's name says little: they are put together in
    bands of 0.1 m.
    """
    drawn = any(one.drawn for one in episodes)

    def place(one: Episode) -> str:
        if drawn:
            low = _BAND * math.floor(one.radius / _BAND + 1e-9)
            return f"{low:.1f}–{low + _BAND:.1f} m"
        return one.door if _is_number(one.door) else f"{one.door} {one.radius:g}"

    return _by(sorted(episodes, key=lambda one: (one.radius, one.door)), place)


def ranked(episodes: Iterable[Episode]) -> dict[str, list[Episode]]:
    """Return episodes by policy: those that open most first, then the gentlest."""

    def rank(item: tuple[str, list[Episode]]) -> tuple[float, float, str]:
        policy, own = item
        rate = sum(one.opened() for one in own) / len(own)
        force = median(map(EPISODE_MEASURES["radial"].of, own))
        return -rate, math.inf if force is None else force, policy

    return dict(sorted(by_policy(episodes).items(), key=rank))


def failures(episodes: Iterable[Episode]) -> dict[str, int]:
    """Count the reasons why the task was not solved, the commonest first."""
    reasons: Counter[str] = Counter()
    for one in episodes:
        if one.error:
            reasons["error"] += 1
        elif not one.solved:
            told = (one.metrics or {}).get("failure") or "no reason given"
            reasons[str(told).replace("_", " ")] += 1
    return dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0])))


def _by(
    outcomes: Iterable[OutcomeT], name: Callable[[OutcomeT], str]
) -> dict[str, list[OutcomeT]]:
    groups: dict[str, list[OutcomeT]] = {}
    for one in outcomes:
        groups.setdefault(name(one), []).append(one)
    return groups


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def named(policies: Mapping[str, object] | Iterable[str]) -> str:
    """List policies in a sentence."""
    return ", ".join(f"`{policy}`" for policy in policies)
