"""Words for the ways in which an episode fails, by the environment's ``failure``."""

from collections.abc import Mapping
from typing import Final

SHORT: Final[Mapping[str, str]] = {
    "stalled": "stuck",
    "latched": "latched",
    "not_grasped": "not grasped",
    "grasp_lost": "let go",
}
"""For labels with little room; others are named by `failure_name`."""

MEANINGS: Final[Mapping[str, str]] = {
    "stalled": "the hand held on and the door gained no more angle",
    "latched": "the latch held the door, whose handle was not turned far enough",
    "not grasped": "the hand did not take hold of the handle",
    "grasp lost": "the handle left the hand",
    "base blocked": "the base was stopped although it was commanded to move",
    "simulation error": "the simulation diverged",
    "time limit": "the time of the episode was over",
    "policy error": "the policy raised an error, in learning or acting",
}
"""In a sentence, by `failure_name`."""


def failure_name(failure: str, unknown: str) -> str:
    """Return a failure as words, or a text where the environment gives none."""
    return failure.replace("_", " ") or unknown
