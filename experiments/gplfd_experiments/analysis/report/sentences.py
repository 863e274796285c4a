"""Sentences that say how one policy stands among the others, from the data alone.

Two policies are compared on the tasks that both ran, seed by seed. A policy is *within
the interval of the best* when the 95 % interval of the paired difference holds zero.
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
    mean_shift,
    paired,
    shift,
    success_rate,
)

PRIVILEGED: Final = frozenset({"oracle"})
"""Policies that know what a robot cannot: compared, but never called the best."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Rival:
    """Another policy beside the one that a sentence is about."""

    name: str
    lead: float
    """How much better it is; negative: worse."""
    beats: bool
    """Whether its lead is significant."""
    text: str
    """Its numbers, in words."""
    unsettled: bool
    """Whether there are too few pairs for an interval."""


def rate_sentence(
    title: str, successes: Mapping[str, Mapping[Key, bool]], policy: str
) -> str:
    """Say how a policy's success rate stands.

    Args:
        title: What succeeds.
        successes: Success by policy and task.
        policy: The policy the sentence is about.
    """
    own = successes.get(policy, {})
    if not own:
        return f"**{title}:** {code(policy)} has no episode that ran."

    def count(rate: Rate) -> str:
        return f"{rate.successes} of {rate.trials} ({rate.interval})"

    def rival(name: str, pairs: Pairs) -> _Rival:
        ours, theirs = int(sum(pairs.first)), map(bool, pairs.second)
        rate = success_rate(zip(pairs.seeds, theirs, strict=True))
        ahead, behind = pairs.per_seed()
        found = mean_shift(behind, ahead)
        return _Rival(
            name=name,
            lead=(rate.successes - ours) / rate.trials,
            beats=found.low > 0.0,
            text=f"{count(rate)} against {ours}",
            unsettled=math.isinf(found.low),
        )

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
    """Say how a policy's numbers stand; less is better.

    Args:
        measure: What the numbers are.
        numbers: Number by policy and task.
        policy: The policy the sentence is about.
        trials: What the independent trials are.

    Returns:
        The sentence; "" if the policy has no numbers, or nothing to compare with.
    """

    def rival(name: str, pairs: Pairs) -> _Rival:
        found = shift(*pairs.per_seed())
        size = abs(found.estimate)
        # A small difference is shown with the decimals that it takes.
        finer = next((n for n in (0, 1) if round(size, measure.digits + n) != 0.0), 2)
        side = "ahead" if found.estimate > 0.0 else "behind"
        interval = "too few for an interval"
        if math.isfinite(found.low):
            sign = 1.0 if found.estimate > 0.0 else -1.0
            ends = sorted((sign * found.low, sign * found.high))
            interval = " to ".join(measure.text(end, finer=finer) for end in ends)
        size_text = measure.text(size, unit=True, finer=finer)
        return _Rival(
            name=name,
            lead=found.estimate,
            beats=found.low > 0.0,
            text=f"{side} by {size_text} ({interval}, {found.n} {trials})",
            unsettled=math.isinf(found.low),
        )

    own = numbers.get(policy, {})
    rivals = _rivals(numbers, policy, rival) if own else []
    if not rivals:
        return ""
    title = measure.phrase[0].upper() + measure.phrase[1:]
    middle = f"median {measure.text(median(own.values()), unit=True)}"
    return f"**{title}:** {_standing(policy, middle, rivals)}"


def _rivals(
    runs: Mapping[str, Mapping[Key, float]],
    policy: str,
    compare: Callable[[str, Pairs], _Rival],
) -> list[_Rival]:
    """Compare a policy with the others on the tasks that both have."""
    rivals = []
    for name in runs.keys() - PRIVILEGED - {policy}:
        pairs = paired(runs[policy], runs[name])
        if pairs.seeds:
            rivals.append(compare(name, pairs))
    return sorted(rivals, key=lambda rival: (-rival.lead, rival.name))


def _standing(policy: str, own: str, rivals: Sequence[_Rival]) -> str:
    """Say whether a policy is best, within the interval of the best, or beaten.

    Args:
        policy: The policy.
        own: Its number, in words.
        rivals: The others, the best first.
    """
    subject = f"{code(policy)}, {own},"
    if not rivals:
        return f"{subject} has nothing to compare with."
    best = rivals[0]
    if best.lead <= 0.0:
        equal = [rival.name for rival in rivals if rival.lead == 0.0]
        together = f" together with {names(equal)}" if equal else ""
        behind = rivals[len(equal) :]
        following = (
            f"; next is {code(behind[0].name)}, {behind[0].text}" if behind else ""
        )
        return f"{subject} is best{together}{following}."
    if beaten := [rival for rival in rivals if rival.beats]:
        winners = "; ".join(f"{code(rival.name)}, {rival.text}" for rival in beaten)
        return f"{subject} is beaten by {winners}."
    if best.unsettled:
        return f"{subject} may be beaten by {code(best.name)}, {best.text}."
    return (
        f"{subject} is within the interval of the best, {code(best.name)}, {best.text}."
    )
