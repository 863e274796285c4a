"""Sentences that rank one policy among the others.

Two policies are compared on the tasks that both ran, seed by seed. A policy is *within
the interval of the best* if the 95 % interval of the paired difference contains zero.
Otherwise it is beaten.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gplfd_experiments.analysis.report.document import code, names
from gplfd_experiments.analysis.results.measures import Measure, median
from gplfd_experiments.analysis.results.statistics import (
    Key,
    Pairs,
    Rate,
    Shift,
    mean_shift,
    paired,
    shift,
    success_rate,
)

PRIVILEGED: Final = frozenset({"oracle"})
"""Policies with information that no robot has: listed, but never called the best."""


@dataclass(frozen=True, slots=True)
class _Rival:
    """A policy that is compared with the subject of a sentence."""

    name: str
    lead: float
    """Difference to the subject; positive if this policy is better."""
    text: str
    """Its numbers as text."""
    difference: Shift
    """Whether the interval of the difference is above zero."""


def rate_sentence(
    title: str, successes: Mapping[str, Mapping[Key, bool]], policy: str
) -> str:
    """Rank a policy's success rate; successes are by policy and task."""
    own = successes.get(policy, {})
    if not own:
        return f"**{title}:** {code(policy)} has no episode that ran."

    def count(rate: Rate) -> str:
        return f"{rate.successes} of {rate.trials} ({rate.interval})"

    def rival(name: str, pairs: Pairs) -> _Rival:
        ours, theirs = int(sum(pairs.first)), map(bool, pairs.second)
        rate = success_rate(zip(pairs.seeds, theirs, strict=True))
        lead = (rate.successes - ours) / rate.trials
        ahead, behind = pairs.per_seed()
        text = f"{count(rate)} against {ours}"
        return _Rival(name, lead, text, mean_shift(behind, ahead))

    rate = success_rate((seed, opened) for (seed, _), opened in own.items())
    # Policies that opened no door are not ranked.
    able = {name: each for name, each in successes.items() if any(each.values())}
    rivals = _rivals({policy: own, **able}, policy, rival)
    if not rate.successes:
        other = "nor did any other policy"
        if rivals:
            other = f"{code(rivals[0].name)} opened most, {rivals[0].text}"
        return f"**{title}:** {code(policy)} opened none of {rate.trials}; {other}."
    if not rivals and successes.keys() - PRIVILEGED - {policy}:
        return (
            f"**{title}:** {code(policy)}, {count(rate)}; no other policy opened a "
            "door."
        )
    return f"**{title}:** {_standing(policy, count(rate), rivals)}"


def value_sentence(
    measure: Measure,
    numbers: Mapping[str, Mapping[Key, float]],
    policy: str,
    trials: str = "seeds",
) -> str:
    """Rank a policy's numbers, less is better; "" if nothing is comparable."""

    def rival(name: str, pairs: Pairs) -> _Rival:
        found = shift(*pairs.per_seed())
        size = abs(found.estimate)
        # A small difference is shown with as many decimals as necessary.
        finer = next((n for n in (0, 1) if round(size, measure.digits + n) != 0.0), 2)
        side = "ahead" if found.estimate > 0.0 else "behind"
        interval = "too few for an interval"
        if math.isfinite(found.low):
            sign = 1.0 if found.estimate > 0.0 else -1.0
            ends = sorted((sign * found.low, sign * found.high))
            interval = " to ".join(measure.text(end, finer=finer) for end in ends)
        by = measure.text(size, unit=True, finer=finer)
        text = f"{side} by {by} ({interval}, {found.n} {trials})"
        return _Rival(name, found.estimate, text, found)

    own = numbers.get(policy, {})
    rivals = _rivals(numbers, policy, rival) if own else []
    if not rivals:
        return ""
    title = measure.name[0].upper() + measure.name[1:]
    middle = f"median {measure.text(median(own.values()), unit=True)}"
    return f"**{title}:** {_standing(policy, middle, rivals)}"


def _rivals(
    runs: Mapping[str, Mapping[Key, float]],
    policy: str,
    compare: Callable[[str, Pairs], _Rival],
) -> list[_Rival]:
    """Compare a policy with the others on the tasks that both have, the best first."""
    others = runs.keys() - PRIVILEGED - {policy}
    pairs = {name: paired(runs[policy], runs[name]) for name in others}
    rivals = [compare(name, both) for name, both in pairs.items() if both.seeds]
    return sorted(rivals, key=lambda rival: (-rival.lead, rival.name))


def _standing(policy: str, own: str, rivals: Sequence[_Rival]) -> str:
    """State whether a policy is best, within the interval of the best, or beaten."""
    subject = f"{code(policy)}, {own},"
    if not rivals:
        return f"{subject} has nothing to compare with."
    best = rivals[0]
    against = f"{code(best.name)}, {best.text}."
    if best.lead <= 0.0:
        equal = [rival.name for rival in rivals if rival.lead == 0.0]
        together = f" together with {names(equal)}" if equal else ""
        behind = rivals[len(equal) :]
        following = (
            f"; next is {code(behind[0].name)}, {behind[0].text}" if behind else ""
        )
        return f"{subject} is best{together}{following}."
    if beaten := [rival for rival in rivals if rival.difference.low > 0.0]:
        winners = "; ".join(f"{code(rival.name)}, {rival.text}" for rival in beaten)
        return f"{subject} is beaten by {winners}."
    if math.isinf(best.difference.low):
        return f"{subject} may be beaten by {against}"
    return f"{subject} is within the interval of the best, {against}"
