"""Why doors stayed closed, counted and in words."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from gplfd_experiments.analysis.results.records import EpisodeResult
from gplfd_experiments.episodes.metrics import why_closed

MEANINGS: Final = {
    "stalled": "the hand held on and the door gained no more angle",
    "latched": "the latch held the door, whose handle was not turned far enough",
    "not grasped": "the hand did not take hold of the handle",
    "grasp lost": "the handle left the hand",
    "base blocked": "the base was stopped although it was commanded to move",
    "simulation error": "the simulation diverged",
    "time limit": "the time of the episode was over",
    "policy error": "the policy raised an error, in learning or acting",
}
"""What each failure of the environment means."""


def failure_of(one: EpisodeResult) -> str:
    """Return the failure of an episode that did not solve the task."""
    return str(one.metrics["failure"]).replace("_", " ") or "no reason given"


def closed_because(episodes: Iterable[EpisodeResult]) -> str:
    """Count why doors stayed closed, over the episodes that count.

    Returns:
        For example ``3 × door did not move further, 1 × hand lost the handle``, the
        most frequent first; "" where all doors were opened.
    """
    reasons: Counter[str] = Counter()
    for one in episodes:
        if one.counts and not one.solved:
            cause = one.metrics.get("reason", "")
            reasons[why_closed(one.metrics["failure"], cause)] += 1
    order = sorted(reasons.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{count} × {reason}" for reason, count in order)
