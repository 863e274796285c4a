"""Sentences that say how one policy stands among the others, from the data alone.

Two policies are compared on the tasks that both ran. A rate that is below the best is
*within the interval of the best* when it lies in the best's 95 % Wilson interval; a
number, when the 95 % interval of the paired difference holds zero. Otherwise the policy
is beaten.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

from experiments.results.measures import Measure, median
from experiments.results.statistics import Shift, shift
from experiments.results.table import wilson_interval

CHAMPION: Final = "gp"
"""The policy that the sentences are about."""
PRIVILEGED: Final = frozenset({"oracle"})
"""Policies that know what a robot cannot: compared, but never called the best."""


def rate_verdict(
    title: str, runs: Mapping[str, Mapping[str, bool]], policy: str = CHAMPION
) -> str:
    """Say how a policy's success rate stands.

    Args:
        title: What succeeds.
        runs: Success by task of every policy, by name.
        policy: The policy the sentence is about.
    """
    own = runs.get(policy, {})
    if not own:
        return f"**{title}:** `{policy}` is not in this study."
    count = f"{sum(own.values())} of {len(own)} {_wilson(own.values())}"
    scores = {rival: _score(own, runs[rival]) for rival in _rivals(runs, policy)}
    scores = {rival: score for rival, score in scores.items() if score.n}
    if not scores:
        return f"**{title}:** `{policy}` {count}; nothing to compare with."
    # The best first; among equals by name.
    order = sorted(scores, key=lambda rival: (-scores[rival].lead, rival))
    best = scores[order[0]]
    if best.lead <= 0.0:
        equal = [rival for rival in order if scores[rival].lead == 0.0]
        together = f" together with {_names(equal)}" if equal else ""
        behind = order[len(equal) :]
        following = ""
        if behind:
            score = scores[behind[0]]
            following = f"; next `{behind[0]}`, {score.other} of {score.n}"
        return f"**{title}:** `{policy}` is best{together}: {count}{following}."
    beaten = [
        f"`{rival}` ({score.other} of {score.n} against {score.own})"
        for rival in order
        if (score := scores[rival]).beats
    ]
    if beaten:
        return f"**{title}:** `{policy}` is beaten by {', '.join(beaten)}."
    return (
        f"**{title}:** `{policy}` is within the interval of the best, `{order[0]}`: "
        f"{best.own} against {best.other} of {best.n} {best.interval}."
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class _Score:
    """Successes of two policies at the tasks that both ran."""

    own: int
    other: int
    n: int

    @property
    def lead(self) -> float:
        """How much larger the other's rate is."""
        return (self.other - self.own) / self.n

    @property
    def beats(self) -> bool:
        """Whether the other's interval leaves the own rate below it."""
        low, _ = wilson_interval(self.other, self.n)
        return self.own / self.n < low

    @property
    def interval(self) -> str:
        return _wilson([True] * self.other + [False] * (self.n - self.other))


def _score(own: Mapping[str, bool], other: Mapping[str, bool]) -> _Score:
    shared = own.keys() & other.keys()
    return _Score(
        own=sum(own[task] for task in shared),
        other=sum(other[task] for task in shared),
        n=len(shared),
    )


def value_verdict(
    measure: Measure,
    runs: Mapping[str, Mapping[str, float]],
    policy: str = CHAMPION,
) -> str:
    """Say how a policy's numbers stand; less is better.

    Args:
        measure: What the numbers are.
        runs: Number by task of every policy, by name.
        policy: The policy the sentence is about.
    """
    title = measure.phrase[0].upper() + measure.phrase[1:]
    own = runs.get(policy, {})
    if not own:
        return f"**{title}:** `{policy}` has no value."
    middle = f"median {measure.text(median(own.values()), unit=True)}"
    shifts = shifts_to(own, {name: runs[name] for name in _rivals(runs, policy)})
    if not shifts:
        return f"**{title}:** `{policy}` {middle}; nothing to compare with."
    best = max(shifts, key=lambda rival: (shifts[rival].estimate, rival))
    if shifts[best].estimate <= 0.0:
        equal = [rival for rival in shifts if shifts[rival].estimate == 0.0]
        behind = [rival for rival in shifts if rival not in equal]
        together = f" together with {_names(equal)}" if equal else ""
        nearest = ""
        if behind:
            rival = max(behind, key=lambda name: (shifts[name].estimate, name))
            nearest = f"; the nearest, `{rival}`, is behind by "
            nearest += _difference(measure, shifts[rival])
        return f"**{title}:** `{policy}` is best{together}, {middle}{nearest}."
    beaten = [
        f"`{rival}` by {_difference(measure, shifts[rival])}"
        for rival in sorted(shifts, key=lambda name: (-shifts[name].estimate, name))
        if shifts[rival].low > 0.0
    ]
    if beaten:
        return f"**{title}:** `{policy}`, {middle}, is beaten by {'; '.join(beaten)}."
    least = _difference(measure, shifts[best])
    if math.isinf(shifts[best].low):
        return (
            f"**{title}:** `{policy}`, {middle}, is behind `{best}` by {least}, which "
            "settles nothing."
        )
    return (
        f"**{title}:** `{policy}`, {middle}, is within the interval of the best, "
        f"`{best}`, behind it by {least}."
    )


def shifts_to(
    own: Mapping[str, float], others: Mapping[str, Mapping[str, float]]
) -> dict[str, Shift]:
    """Return how much larger a policy's numbers are than each other's, in pairs."""
    shifts = {}
    for name, numbers in others.items():
        shared = sorted(own.keys() & numbers.keys())
        if shared:
            shifts[name] = shift(
                [own[task] for task in shared], [numbers[task] for task in shared]
            )
    return shifts


def _rivals(runs: Mapping[str, object], policy: str) -> list[str]:
    return [name for name in runs if name != policy and name not in PRIVILEGED]


def _difference(measure: Measure, found: Shift) -> str:
    """How much less the better one has, with interval and number of pairs."""
    size = abs(found.estimate)
    # A small difference is shown with the decimals that it takes.
    finer = next((n for n in (0, 1) if round(size, measure.digits + n) != 0.0), 2)
    text = measure.text(size, unit=True, finer=finer)
    if math.isinf(found.low):
        return f"{text} (n = {found.n}, too few for an interval)"
    sign = 1.0 if found.estimate > 0.0 else -1.0
    low, high = sorted((sign * found.low, sign * found.high))
    return (
        f"{text} ({measure.text(low, finer=finer)} to "
        f"{measure.text(high, finer=finer)}, n = {found.n})"
    )


def _wilson(successes: Collection[bool]) -> str:
    low, high = wilson_interval(sum(successes), len(successes))
    return f"({low:.2f}–{high:.2f})"


def _names(policies: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in policies)
