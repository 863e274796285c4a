"""Why doors stayed closed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Final

from experiments.report.columns import Column, policy_table
from experiments.report.document import Block, Paragraph, Section, literal, names
from experiments.results.grouping import ranked
from experiments.results.records import EpisodeResult

Episodes = Sequence[EpisodeResult]

_MEANING: Final = {
    "stalled": "the hand held on and the door gained no more angle",
    "grasp lost": "the handle left the hand",
    "simulation error": "the simulation diverged",
    "time limit": "the episode's time was over",
}


def shortfall_section(episodes: Episodes) -> Section:
    """Say what kept doors closed."""
    runs = {policy: own for policy, own in ranked(episodes).items() if own}
    never = [name for name, own in runs.items() if not any(e.opened() for e in own)]
    text = "Every policy with an episode that ran opened at least one door to 60°."
    if never:
        text = f"**No door to 60°:** {names(never)}."
    blocks: list[Block] = [Paragraph(text=text)]
    closed = {name: own for name, own in runs.items() if _why(own)}
    reasons = sorted({reason for own in closed.values() for reason in _why(own)})
    columns: dict[str, Column] = {
        literal(reason): (closed, partial(_count, reason)) for reason in reasons
    }
    columns["median angle"] = (closed, partial(_angle, median))
    columns["largest angle"] = (closed, partial(_angle, max))
    meanings = [f"{each}: {_MEANING[each]}." for each in reasons if each in _MEANING]
    note = (
        "Episodes that did not solve the task, 60° held for 0.5 s with the handle in "
        "the hand, by the reason that the environment gives, and final angles of all "
        f"episodes. {' '.join(meanings)}"
    )
    if closed:
        blocks.append(policy_table(closed, columns, note))
    title = "Why doors stayed closed"
    return Section(title=title, anchor="shortfalls", blocks=tuple(blocks))


def _why(own: Episodes) -> Counter[str]:
    """Count the reasons why episodes did not solve the task."""
    return Counter(
        one.metrics["failure"].replace("_", " ") or "no reason given"
        for one in own
        if not one.solved
    )


def _count(reason: str, own: Episodes) -> str:
    return str(_why(own)[reason])


def _angle(of: Callable[[Sequence[float]], float], own: Episodes) -> str:
    angles = [one.number("final_angle_deg") for one in own]
    known = [angle for angle in angles if angle is not None]
    return f"{of(known):.1f}°" if known else "–"
