"""How the policies opened doors under one condition: rates, forces, times, tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final, TypeVar

from experiments.files.table import Table
from experiments.report.columns import Column, count, medians, policy_table
from experiments.report.document import Block, Items, Paragraph, code, literal
from experiments.report.sentences import rate_sentence, value_sentence
from experiments.results.grouping import Comparison, Runs, numbers
from experiments.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    HEADLINES,
    TESTED,
    Measure,
    number_text,
)
from experiments.results.records import UNDEMONSTRATED, EpisodeResult
from experiments.results.statistics import (
    PairedTest,
    holm,
    interval_text,
    mcnemar,
    paired,
    shift,
    signed_rank,
)

ANGLES: Final = (60, 30, 15)
"""Angles that count as opened [deg], the task's own first."""

ValueT = TypeVar("ValueT")

Episodes = Sequence[EpisodeResult]


def sentences(comparison: Comparison, reference: str) -> Items:
    """Say how the reference stands, measure by measure."""
    runs = comparison.runs
    texts = [rate_sentence("Doors opened to 60°", _opened(runs), reference)]
    if len(comparison.kinds) > 1 and UNDEMONSTRATED in comparison.kinds:
        title = "Of these, doors of undemonstrated radius"
        opened = _opened(comparison.kinds[UNDEMONSTRATED])
        texts.append(rate_sentence(title, opened, reference))
    title = "Opened and held, the handle in the hand"
    texts.append(rate_sentence(title, _opened(runs, held=True), reference))
    for name in HEADLINES:
        measure = EPISODE_MEASURES[name]
        texts.append(value_sentence(measure, numbers(runs, measure), reference))
    return Items(texts=tuple(texts))


def _opened(runs: Runs, *, held: bool = False) -> dict[str, dict[str, bool]]:
    """Return success by policy and task: opened to 60 degrees, or held there, too."""
    return {
        policy: {one.pair: one.solved if held else one.opened() for one in own}
        for policy, own in runs.items()
    }


def rate_table(comparison: Comparison) -> Table:
    """Success on all doors, by kind of door and door by door; angles on all doors."""
    columns: dict[str, Column] = {"solved": (comparison.runs, _solved)}
    for angle in ANGLES:
        columns[f"to {angle}°"] = (comparison.runs, partial(_reached, angle))
    for name, runs in {**comparison.kinds, **comparison.doors}.items():
        columns[literal(name)] = (runs, _solved_or_opened)
    if comparison.failed:
        columns["errors"] = (comparison.failed, count)
    note = (
        "Solved / ran: open by 60° for 0.5 s with the handle in the hand, on all doors "
        "and then by kind and by door. To 60°, 30°, 15°: opened so far, if only for a "
        "moment. Wilson's 95 % intervals; policies in order of opening to 60°, then of "
        "radial force."
    )
    return policy_table(comparison.runs, columns, note)


def _rate(successes: int, own: Episodes) -> str:
    return f"{successes}/{len(own)}\n{interval_text(successes, len(own))}"


def _reached(angle: int, own: Episodes) -> str:
    return _rate(sum(one.opened(angle) for one in own), own)


def _solved(own: Episodes) -> str:
    return _rate(sum(one.solved for one in own), own)


def _solved_or_opened(own: Episodes) -> str:
    opened = sum(one.opened() for one in own)
    differs = opened != sum(one.solved for one in own)
    return _solved(own) + (f"\nto 60°: {opened}" if differs else "")


def quality_tables(comparison: Comparison) -> list[Block]:
    """Forces, times and the rest, by kind of door; radial force door by door."""
    policies = comparison.runs
    text = (
        "Forces, slip and work over the doors opened to 60°, the others over all "
        "episodes that have them. A policy that opens few doors has few numbers: the "
        f"paired tests compare equal doors. Above {ADA_FORCE} N: openings with a peak, "
        "tangential or radial, above the limit of ADA 404.2.9 for opening an interior "
        "door."
    )
    blocks: list[Block] = [Paragraph(text=text)]
    for kind, runs in comparison.kinds.items():
        columns: dict[str, Column] = {
            "opened": (runs, _opened_text),
            **medians(runs, EPISODE_MEASURES.values()),
            f"above {ADA_FORCE} N": (runs, _above_text),
        }
        blocks.append(policy_table(policies, columns, f"Medians on {kind}."))
    columns = {}
    for door, runs in comparison.doors.items():
        (column,) = medians(runs, [EPISODE_MEASURES["force_radial_peak"]]).values()
        columns[literal(door)] = column
    note = "Peak radial force [N] door by door, medians over the doors opened to 60°."
    return [*blocks, policy_table(policies, columns, note)]


def _opened_text(own: Episodes) -> str:
    return f"{sum(one.opened() for one in own)}/{len(own)}"


def _above_text(own: Episodes) -> str:
    opened = [one for one in own if one.opened()]
    forces = ("force_tangential_peak", "force_radial_peak")
    above = sum(
        any((one.number(force) or 0.0) > ADA_FORCE for force in forces)
        for one in opened
    )
    return f"{above}/{len(opened)}" if opened else "–"


def paired_tests(comparison: Comparison, reference: str) -> Block:
    """Compare the reference with every other policy on the same tasks."""
    runs = comparison.runs
    others = [policy for policy in runs if policy != reference]
    if reference not in runs or not others:
        return Paragraph(text=f"There is nothing to compare {code(reference)} with.")
    columns = {"opened to 60°": _tests(_opened(runs), reference, _successes)}
    for measure in map(EPISODE_MEASURES.__getitem__, TESTED):
        compare = partial(_values, measure)
        columns[measure.title] = _tests(numbers(runs, measure), reference, compare)
    rows = tuple(
        (code(other), *(column.get(other, "–") for column in columns.values()))
        for other in others
    )
    note = (
        f"{code(reference)} against each other policy on the same door and seed. "
        f"Success: doors that only one of the two opened ({code(reference)} : other), "
        f"McNemar's exact test. Numbers: {code(reference)} minus the other on doors "
        "that both opened, after Hodges and Lehmann, Wilcoxon's signed-rank test; – "
        "where there is none. p after Holm for all tests of a column; n pairs."
    )
    return Table(columns=("against", *columns), rows=rows, note=note)


def _tests(
    values: Mapping[str, Mapping[str, ValueT]],
    reference: str,
    compare: Callable[[Sequence[ValueT], Sequence[ValueT]], tuple[str, PairedTest]],
) -> dict[str, str]:
    """Compare the reference with the others; p corrected for all of them."""
    found = {}
    for other in values:
        ours, theirs = paired(values[reference], values[other])
        if ours and other != reference:
            found[other] = compare(ours, theirs)
    corrected = holm([test.p for _, test in found.values()])
    return {
        other: f"{text}\n{_p_text(p)}, n {test.n}"
        for (other, (text, test)), p in zip(found.items(), corrected, strict=True)
    }


def _successes(ours: Sequence[bool], theirs: Sequence[bool]) -> tuple[str, PairedTest]:
    test = mcnemar(ours, theirs)
    wins = sum(a > b for a, b in zip(ours, theirs, strict=True))
    return f"{wins} : {test.n_different - wins}", test


def _values(
    measure: Measure, ours: Sequence[float], theirs: Sequence[float]
) -> tuple[str, PairedTest]:
    typical = shift(ours, theirs).estimate
    text = number_text(typical, measure.digits, signed=True)
    return text, signed_rank(ours, theirs)


def _p_text(p: float) -> str:
    """Write a probability; bold when below 5 %."""
    text = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
    return f"**{text}**" if p < 0.05 else text
