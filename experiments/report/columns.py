"""Tables with a row per policy, written column by column."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from experiments.files.table import Table
from experiments.report.document import code
from experiments.results.measures import Measure
from experiments.results.records import TaskResult

Column = tuple[Mapping[str, Sequence[Any]], Callable[[Sequence[Any]], str]]
"""Results by policy, and how a cell says what they are."""


def policy_table(
    policies: Iterable[str], columns: Mapping[str, Column], note: str = ""
) -> Table:
    """Return a row per policy.

    Args:
        policies: In order.
        columns: By their heads. A policy without results has a dash.
        note: What a reader has to know.
    """
    rows = tuple(
        (
            code(policy),
            *(
                text(results[policy]) if results.get(policy) else "–"
                for results, text in columns.values()
            ),
        )
        for policy in policies
    )
    return Table(columns=("policy", *columns), rows=rows, note=note)


def medians(
    results: Mapping[str, Sequence[TaskResult]], measures: Iterable[Measure]
) -> dict[str, Column]:
    """Return a column per measure."""

    def text_of(measure: Measure) -> Callable[[Sequence[TaskResult]], str]:
        return lambda own: measure.text(measure.median(own))

    return {measure.title: (results, text_of(measure)) for measure in measures}


def count(results: Sequence[Any]) -> str:
    """Write how many there are."""
    return str(len(results))
