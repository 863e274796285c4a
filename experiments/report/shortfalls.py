"""Which policies opened no door, and why doors stayed closed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from experiments.report.document import Block, Paragraph, Section, Table
from experiments.results.grouping import failures, ranked
from experiments.results.measures import EPISODE_MEASURES, median
from experiments.results.records import Episode

_MEANING: Final = {
    "stalled": "the hand held on and the door gained no more angle",
    "grasp lost": "the handle left the hand",
    "simulation error": "the simulation diverged",
    "time limit": "the episode's time was over",
    "error": "the policy could not learn or act",
}


def shortfall_section(episodes: Sequence[Episode]) -> Section:
    """Say what kept doors closed."""
    runs = ranked(episodes)
    never = [name for name, own in runs.items() if not any(e.opened() for e in own)]
    blocks: list[Block] = [_never(name, runs[name]) for name in never]
    if not never:
        blocks.append(Paragraph(text="Every policy opened at least one door to 60°."))
    failed = {name: failures(own) for name, own in runs.items()}
    reasons = sorted({reason for counts in failed.values() for reason in counts})
    if reasons:
        rows = tuple(
            (
                f"`{name}`",
                *(str(failed[name].get(reason, 0)) for reason in reasons),
                _degrees(median(e.number("final_angle_deg") for e in own)),
                _degrees(_largest(own)),
            )
            for name, own in runs.items()
            if failed[name]
        )
        note = "; ".join(
            f"{reason}: {_MEANING[reason]}" for reason in reasons if reason in _MEANING
        )
        blocks.append(
            Table(
                columns=("policy", *reasons, "median angle", "largest angle"),
                rows=rows,
                note="Episodes that did not solve the task, 60° held for 0.5 s with "
                "the handle in the hand, by the reason that the environment gives, and "
                f"final angles of all episodes. {note}.",
            )
        )
    return Section(
        title="Policies that opened no door, and why",
        anchor="shortfalls",
        blocks=tuple(blocks),
    )


def _never(policy: str, own: Sequence[Episode]) -> Paragraph:
    counts = failures(own)
    reasons = ", ".join(
        f"{count} × {reason}" + (f" ({_MEANING[reason]})" if reason in _MEANING else "")
        for reason, count in counts.items()
    )
    text = f"**`{policy}`** opened none of {len(own)} doors: {reasons}."
    largest = _largest(own)
    if largest is not None:
        text += f" Its widest opening was {largest:.1f}°."
    errors = sorted({one.error for one in own if one.error})
    if errors:
        text += f" First error: `{errors[0].replace('`', chr(39))}`."
    error = median(map(EPISODE_MEASURES["error"].of, own))
    if error is not None:
        text += f" Median prediction error √E[ε²]: {error:.1f} mm."
    return Paragraph(text=text)


def _largest(own: Sequence[Episode]) -> float | None:
    angles = [e.number("final_angle_deg") for e in own]
    return max((angle for angle in angles if angle is not None), default=None)


def _degrees(angle: float | None) -> str:
    return "–" if angle is None else f"{angle:.1f}°"
