"""Why doors stayed closed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Final

from experiments.files.table import Table
from experiments.report.document import (
    Block,
    Paragraph,
    Section,
    code,
    literal,
    names,
)
from experiments.results.grouping import Runs, ranked
from experiments.results.records import EpisodeResult

_MEANING: Final = {
    "stalled": "the hand held on and the door gained no more angle",
    "grasp lost": "the handle left the hand",
    "simulation error": "the simulation diverged",
    "time limit": "the episode's time was over",
}


def shortfall_section(episodes: Sequence[EpisodeResult]) -> Section:
    """Say what kept doors closed."""
    runs = {policy: own for policy, own in ranked(episodes).items() if own}
    never = [name for name, own in runs.items() if not any(e.opened() for e in own)]
    text = "Every policy with an episode that ran opened at least one door to 60°."
    if never:
        text = f"**No door to 60°:** {names(never)}."
    blocks: list[Block] = [Paragraph(text=text)]
    shortfalls = {name: reasons for name, own in runs.items() if (reasons := _why(own))}
    if shortfalls:
        blocks.append(_table(runs, shortfalls))
    return Section(
        title="Why doors stayed closed", anchor="shortfalls", blocks=tuple(blocks)
    )


def _table(runs: Runs, shortfalls: Mapping[str, Counter[str]]) -> Table:
    columns = sorted({reason for counts in shortfalls.values() for reason in counts})
    rows = []
    for policy, counts in shortfalls.items():
        angles = [one.number("final_angle_deg") for one in runs[policy]]
        known = [angle for angle in angles if angle is not None]
        cells = (f"{of(known):.1f}°" if known else "–" for of in (median, max))
        rows.append((code(policy), *(str(counts[each]) for each in columns), *cells))
    meanings = [f"{each}: {_MEANING[each]}." for each in columns if each in _MEANING]
    return Table(
        columns=("policy", *map(literal, columns), "median angle", "largest angle"),
        rows=tuple(rows),
        note="Episodes that did not solve the task, 60° held for 0.5 s with the handle "
        "in the hand, by the reason that the environment gives, and final angles of "
        f"all episodes. {' '.join(meanings)}",
    )


def _why(own: Sequence[EpisodeResult]) -> Counter[str]:
    """Count the reasons why episodes did not solve the task."""
    return Counter(
        one.metrics["failure"].replace("_", " ") or "no reason given"
        for one in own
        if not one.solved
    )
