"""Why doors stayed closed, counted and in words."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from gplfd.experiments.results.records import EpisodeResult

ERROR: Final = "policy error"
"""What an episode that ended in an error counts as."""

MEANINGS: Final = {
    "stalled": "the hand held on and the door gained no more angle",
    "latched": "the latch held the door, whose handle was not turned far enough",
    "not grasped": "the hand did not take hold of the handle",
    "grasp lost": "the handle left the hand",
    "simulation error": "the simulation diverged",
    "time limit": "the time of the episode was over",
    ERROR: "the policy raised an error",
}
"""What each failure of the environment means."""


def failure_of(one: EpisodeResult) -> str:
    """Return the failure of an episode that did not solve the task."""
    if one.error:
        return ERROR
    return str(one.metrics["failure"]).replace("_", " ") or "no reason given"


def why_closed(episodes: Iterable[EpisodeResult]) -> str:
    """Count the failures of the episodes that did not solve the task.

    Returns:
        For example ``3 × stalled (too heavy), 1 × grasp lost``, the most frequent
        first; "" where all doors were opened.
    """
    failures: Counter[str] = Counter()
    for one in episodes:
        if not one.solved:
            failure = failure_of(one)
            behind = str(one.metrics.get("reason", "")).replace("_", " ")
            more = behind not in ("", failure, "handle lost")
            failures[f"{failure} ({behind})" if more else failure] += 1
    order = sorted(failures.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{count} × {failure}" for failure, count in order)
