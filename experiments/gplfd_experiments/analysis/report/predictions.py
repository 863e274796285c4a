"""Prediction errors of methods on left-out demonstrations and recordings.

A measured number is added to every mark of Table 1 of the paper. The measures and their
limits are in `gplfd_experiments.studies.learning_tests.criteria`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from gplfd_experiments.analysis.report.document import (
    Block,
    Column,
    Section,
    Text,
    code,
    measure_column,
    policy_table,
)
from gplfd_experiments.analysis.results.measures import (
    FORCE_MEASURES,
    LEARNING_MEASURES,
    RECORDED_MEASURES,
    Measure,
    by_condition,
    by_policy,
)
from gplfd_experiments.analysis.results.reading import TaskResult
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.learning_tests.criteria import CRITERIA, mark
from gplfd_policies.registry.built_in import TABLE_1

Results = Sequence[TaskResult]

_LEFT_OUT: Final = {
    "demonstration": "One demonstration left out",
    "radius": "The middle radius left out",
}
_MEASURES: Final = {**LEARNING_MEASURES, **RECORDED_MEASURES, **FORCE_MEASURES}
_SUMMARY: Final = (
    *("nlpd", "rmse_position_m", "rmse_rotation_rad", "coverage_95"),
    *("forecast_25_nlpd", "forecast_25_position_m"),
    *("online_25_nlpd", "online_25_position_m", "online_25_coverage_95"),
)
"""Measures in the summary of recordings."""
_NOTE: Final = (
    "Medians. NLPD: negative log predictive density, in natural units of metres and "
    "radians, of forces in newtons and newton metres; less is better. Inside: share of "
    "the left-out numbers within the stated intervals. After a part: errors of the "
    "rest, at known phases; online: with the phase estimated from the samples so far."
)
_SIGN: Final = {True: "✓", False: "✗", None: "?"}


def learning_section(tests: Results) -> Section:
    """Return all measures of learning tests without a robot."""
    groups = {
        f"{left_out}: {condition.teaching}": here
        for condition, those in by_condition(tests).items()
        for held_out, left_out in _LEFT_OUT.items()
        if (here := [test for test in those if test.left_out == held_out])
    }
    return Section("What was learned, without a robot", [_all_measures(groups)])


def recorded_section(results: Results) -> Section:
    """Return all methods on recordings, each left out in turn."""
    introduction = (
        "Each recording is left out in turn and predicted from the others. The phase "
        "is the share of the path that the hand has covered; **online**, the method "
        "estimates it from the samples so far, as on a robot."
    )
    tables = overview(results), _all_measures({"": results})
    title = "What was learned from the recordings"
    return Section(title, [Text(introduction), *tables])


def overview(results: Results) -> Table:
    """Return the headlines of all methods, ordered by likelihood."""

    def likelihood(item: tuple[str, Results]) -> float:
        median = _MEASURES["nlpd"].median(test for test in item[1] if not test.error)
        return math.inf if median is None else median

    order = sorted(by_policy(results).items(), key=likelihood)
    note = f"**n:** recordings left out, one at a time. {_NOTE}"
    number, *medians = _columns(_SUMMARY)
    return policy_table({"": dict(order)}, [*medians, number], note=note)


def _columns(metrics: Iterable[str]) -> list[Column]:
    """Return a column with the number of results, and one with each median."""
    number = Column("n", lambda results: str(len(results)))
    return [number, *(measure_column(Measure.median, _MEASURES[n]) for n in metrics)]


def _all_measures(groups: Mapping[str, Results]) -> Table:
    """Return the medians of all measures that any of the tests has."""
    tests = [test for group in groups.values() for test in group]
    metrics = [n for n in _MEASURES if any(t.number(n) is not None for t in tests)]
    runs = {title: by_policy(group) for title, group in groups.items()}
    return policy_table(runs, _columns(metrics), title="All measures", note=_NOTE)


def table_one_section(tests: Results) -> Section:
    """The paper's rows and methods, measured marks, and differences."""
    # The condition with most tests.
    ran = by_condition(test for test in tests if not test.error)
    standard = by_policy(next(iter(ran.values()), []))
    foreign = dict.fromkeys(test.policy for test in tests if test.policy_source)
    tuned = [f"{policy}-tuned" for policy in TABLE_1]
    blocks: list[Block] = []
    for title, policies in (
        ("Marks with their numbers", (*TABLE_1, *foreign)),
        ("Marks of the tuned methods", tuned),
    ):
        here = {p: [t.metrics for t in standard[p]] for p in policies if p in standard}
        if here:
            blocks.append(_marks(here, title))
    meanings = Table(
        columns=("row", "what is measured"),
        rows=tuple((item.row, item.sentence) for item in CRITERIA.values()),
        title="What the rows mean",
        left=True,
    )
    return Section("Table 1 of the paper, measured", [*blocks, meanings])


def _marks(measured: Mapping[str, Sequence[Mapping[str, Any]]], title: str) -> Table:
    """Return a row per criterion with a mark and a number per policy."""
    rows: list[tuple[str, ...]] = []
    for row, criterion in CRITERIA.items():
        limit = criterion.limits[0]
        bounded = limit.high < math.inf
        bound = f"≤ {limit.high:g}" if bounded else f"≥ {limit.low:g}"
        cells = [f"{row}\n{limit.symbol} {bound}"]
        for policy, metrics in measured.items():
            earned, published = mark(criterion, metrics), policy in criterion.paper
            text, value = _SIGN[earned.passed], earned.value
            if value is not None and 0.0 < abs(value) < 1e-3:
                text += " < 0.001" if value > 0.0 else " > −0.001"
            elif value is not None:
                text += f" {value:.3g}".replace("-", "−")
            if policy in TABLE_1 and earned.passed not in (None, published):
                text = f"**{text}**\n(paper {_SIGN[published]})"
            cells.append(text)
        rows.append(tuple(cells))
    note = (
        "✓ and ✗: whether the number earns the mark by the limits below; where the "
        "paper says otherwise, its own mark is given. Means over the learning tests. "
        "The paper's column GP is `local-gp` and `wishart-gp`, its last one `gp-paper` "
        "as published and `gp` as developed here. Tuned: with the settings that "
        "benchmarks/tune.py found for each method."
    )
    columns = ("", *map(code, measured))
    return Table(columns=columns, rows=tuple(rows), title=title, note=note)
