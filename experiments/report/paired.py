"""How the reference stands beside the other policies on the same doors and seeds."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from experiments.files.table import Table
from experiments.report.document import Block, Items, Paragraph, code
from experiments.report.sentences import rate_sentence, value_sentence
from experiments.results.grouping import Runs, numbers, of_kind
from experiments.results.measures import (
    EPISODE_MEASURES,
    HEADLINES,
    TESTED,
    Measure,
    number_text,
)
from experiments.results.records import UNDEMONSTRATED
from experiments.results.statistics import (
    holm,
    mcnemar,
    paired,
    shift,
    signed_rank,
)

ValueT = TypeVar("ValueT")


def standing(runs: Runs, reference: str) -> Items:
    """Say how the reference stands, measure by measure.

    Args:
        runs: Episodes that ran, of one condition.
        reference: Name of a policy.
    """
    opened = _successes(runs)
    texts = [rate_sentence("Doors opened to 60°", opened, reference)]
    kinds = {one.kind for own in runs.values() for one in own}
    if len(kinds) > 1 and UNDEMONSTRATED in kinds:
        title = "Of these, doors of undemonstrated radius"
        new = _successes(of_kind(runs, UNDEMONSTRATED))
        texts.append(rate_sentence(title, new, reference))
    title = "Opened and held, the handle in the hand"
    texts.append(rate_sentence(title, _successes(runs, held=True), reference))
    for measure in map(EPISODE_MEASURES.__getitem__, HEADLINES):
        texts.append(value_sentence(measure, numbers(runs, measure), reference))
    return Items(texts=tuple(texts))


def _successes(runs: Runs, *, held: bool = False) -> dict[str, dict[str, bool]]:
    """Return success by policy and task: opened to 60 degrees, or held there, too."""
    return {
        policy: {one.pair: one.solved if held else one.opened() for one in own}
        for policy, own in runs.items()
    }


def paired_tests(runs: Runs, reference: str) -> Block:
    """Compare the reference with every other policy on the same tasks."""
    others = [policy for policy in runs if policy != reference]
    if reference not in runs or not others:
        return Paragraph(text=f"There is nothing to compare {code(reference)} with.")
    columns = {"opened to 60°": _tests(_successes(runs), reference, _wins)}
    for measure in map(EPISODE_MEASURES.__getitem__, TESTED):
        values = numbers(runs, measure)
        columns[measure.title] = _tests(values, reference, partial(_shift, measure))
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
    compare: Callable[[Sequence[ValueT], Sequence[ValueT]], tuple[str, float]],
) -> dict[str, str]:
    """Compare the reference with the others; p corrected for all of them."""
    pairs = {
        other: paired(values[reference], values[other])
        for other in values
        if other != reference and values[reference].keys() & values[other].keys()
    }
    found = {other: compare(*both) for other, both in pairs.items()}
    corrected = holm([p for _, p in found.values()])
    return {
        other: f"{text}\n{_p_text(p)}, n {len(pairs[other][0])}"
        for (other, (text, _)), p in zip(found.items(), corrected, strict=True)
    }


def _wins(ours: Sequence[bool], theirs: Sequence[bool]) -> tuple[str, float]:
    wins = sum(a and not b for a, b in zip(ours, theirs, strict=True))
    losses = sum(b and not a for a, b in zip(ours, theirs, strict=True))
    return f"{wins} : {losses}", mcnemar(wins, losses)


def _shift(
    measure: Measure, ours: Sequence[float], theirs: Sequence[float]
) -> tuple[str, float]:
    typical = shift(ours, theirs).estimate
    text = number_text(typical, measure.digits, signed=True)
    return text, signed_rank(ours, theirs)


def _p_text(p: float) -> str:
    """Write a probability; bold when below 5 %."""
    text = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
    return f"**{text}**" if p < 0.05 else text
