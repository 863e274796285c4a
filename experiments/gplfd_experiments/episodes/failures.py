"""Texts for the environment's ``failure`` and ``reason`` of an episode."""

from collections.abc import Mapping
from typing import Final

from gplfd_env.task.stages import HEAVY_FORCE

SHORT: Final[Mapping[str, str]] = {
    "stalled": "stuck",
    "latched": "latched",
    "not_grasped": "not grasped",
    "grasp_lost": "let go",
}
"""Short labels; other failures are named by `failure_name`."""

_WORDS: Final[Mapping[str, str]] = {
    "grasp_lost": "hand lost the handle",
    "base_blocked": "base was blocked",
    "stalled": "door did not move further",
    "latched": "latch was not released",
    "not_grasped": "handle was not grasped",
    "simulation_error": "simulation diverged",
    "policy_error": "policy raised an error",
    "time_limit": "time ran out",
    "blocked": "something blocked the door",
    "out_of_reach": "an arm joint was at its limit",
    "too_heavy": f"it took more than {HEAVY_FORCE:g} N",
}
"""Plain words for ``failure`` and ``reason`` of an episode."""


def failure_name(failure: str, unknown: str) -> str:
    """Return a failure as text, or another text if the environment gives none."""
    return failure.replace("_", " ") or unknown


def why_closed(failure: str, reason: str) -> str:
    """Return in plain words why a door was not opened; "" if it was."""
    words = _WORDS.get(failure, failure.replace("_", " "))
    # Without a separate cause, the reason repeats the failure.
    cause = "" if reason in (failure, "handle_lost") else _WORDS.get(reason, reason)
    return f"{words}: {cause}" if cause else words
