"""Tables with a row per policy, in groups, written column by column."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gplfd_experiments.analysis.report.document import code
from gplfd_experiments.analysis.results.grouping import counted
from gplfd_experiments.analysis.results.measures import Measure
from gplfd_experiments.files.table import Table

Cell = Callable[[Sequence[Any]], str]
"""Text of a cell from the results of a policy that count."""


def policy_table(
    groups: Mapping[str, Mapping[str, Sequence[Any]]],
    columns: Mapping[str, Cell],
    note: str = "",
) -> Table:
    """Return a row per policy, in groups under headings unless there is only one.

    Errors are counted below the policy's name; one without other results has dashes.
    """
    rows: list[tuple[str, ...]] = []
    for title, results in groups.items():
        if len(groups) > 1:
            rows.append((f"**{title}**", *("" for _ in columns)))
        for policy, ran in counted(results).items():
            name = code(policy)
            own = results[policy]
            if failed := sum(bool(one.error) and not one.lost for one in own):
                name += f"\nerrors: {failed}"
            if lost := sum(one.lost for one in own):
                name += f"\nlost: {lost}"
            cells = (cell(ran) if ran else "–" for cell in columns.values())
            rows.append((name, *cells))
    return Table(columns=("policy", *columns), rows=tuple(rows), note=note)


def medians(*measures: Measure) -> dict[str, Cell]:
    """Return a column with the median of a measure, those of others below it."""

    def cell(results: Sequence[Any]) -> str:
        return "\n".join(one.text(one.median(results)) for one in measures)

    return {"\n".join(one.title for one in measures): cell}
