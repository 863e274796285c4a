"""Prediction errors of methods on left-out demonstrations and recordings.

A measured number is added to every mark of Table 1 of the paper. The measures and their
limits are in `gplfd_experiments.studies.learning_tests.criteria`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

from gplfd_experiments.analysis.report.document import (
    Cell,
    Section,
    code,
    medians,
    policy_table,
)
from gplfd_experiments.analysis.report.plots import LeftOut, coverage, prediction_scores
from gplfd_experiments.analysis.results.measures import (
    FORCE_MEASURES,
    LEARNING_HEADLINES,
    LEARNING_MEASURES,
    RECORDED_MEASURES,
    Measure,
    by_condition,
    by_policy,
)
from gplfd_experiments.analysis.results.reading import (
    LearningTestResult,
    RecordedResult,
)
from gplfd_experiments.files.table import Table, text_table
from gplfd_experiments.studies.learning_tests.criteria import CRITERIA, mark
from gplfd_policies.registry.built_in import TABLE_1

Tests = Sequence[LearningTestResult]
Results = Sequence[RecordedResult]

_LEFT_OUT: Final = {
    "demonstration": "One demonstration left out",
    "radius": "The middle radius left out",
}
_MEASURES: Final[Mapping[str, Measure]] = {
    **LEARNING_MEASURES,
    **RECORDED_MEASURES,
    **FORCE_MEASURES,
}
_SUMMARY: Final = (
    *(*LEARNING_HEADLINES, "coverage_95"),
    *("forecast_25_nlpd", "forecast_25_position_m"),
    *("online_25_nlpd", "online_25_position_m", "online_25_coverage_95"),
)
"""Measures in the summary."""
_FORCES: Final = tuple(FORCE_MEASURES)
_TABLES: Final[Mapping[str, tuple[str, ...]]] = {
    "A recording that was not seen": tuple(
        name for name in LEARNING_MEASURES if name != "via_far_change"
    ),
    "Its rest, once a part has been seen": tuple(
        name for name in RECORDED_MEASURES if name.startswith("forecast")
    ),
    "The same online": tuple(
        name for name in RECORDED_MEASURES if name.startswith("online")
    ),
    "Its force, and that of its rest once a part has been felt": _FORCES,
}
"""Columns of the tables of recordings by their title."""

_FORCE_NOTE: Final = (
    "Force and moment of what is left out, before any force was measured and of the "
    "rest once a part was, at known phases. NLPD in newtons and newton metres."
)
_SIGN: Final = {True: "✓", False: "✗", None: "?"}
_TUNED: Final = tuple(f"{policy}-tuned" for policy in TABLE_1)
_TINY: Final = 1e-3
"""Smaller numbers are shown as less than this."""

Metrics = dict[str, list[Mapping[str, Any]]]
"""Metrics of every learning test, by policy."""


def learning_section(tests: Tests, reference: str) -> Section:
    """All learning tests in one table; plots of the first condition."""
    section = Section("What was learned, without a robot", "learning")
    ran = [one for one in tests if not one.error]
    if not ran:
        section.say(
            "This study has no learning test with a result: `gplfd benchmark` makes "
            "them unless it is given `--no-skill`."
        )
        return section
    groups = {
        f"{left_out}: {condition.teaching}": by_policy(own)
        for condition, those in by_condition(tests).items()
        for held_out, left_out in _LEFT_OUT.items()
        if (own := [test for test in those if test.task.held_out == held_out])
    }
    note = (
        "What is left out is predicted and compared with what was done: medians over "
        "the seeds. NLPD in natural units of metres and radians; inside: share of the "
        "left-out numbers within the stated intervals."
    )
    table = policy_table(groups, _columns(LEARNING_MEASURES), note)
    section.table(table, folded="All measures of the learning tests")
    if any(one.number("force_error_n") is not None for one in ran):
        table = policy_table(groups, _columns(_FORCES), _FORCE_NOTE)
        section.table(table, folded="Forces of the learning tests")

    standard = next(iter(by_condition(ran).values()))
    _add_plots(section, standard, reference)
    return section


def recorded_section(results: Results, reference: str) -> Section:
    """All methods on recordings, each left out in turn: tables and plots."""
    section = Section("What was learned from the recordings", "recorded")
    runs = by_policy(results)
    section.say(
        "Each recording is left out in turn and predicted from the others. The phase "
        "is the share of the path that the hand has covered; **online**, the method "
        "estimates it from the samples so far, as on a robot. Less is better. NLPD is "
        "over the outputs that move, in metres and radians."
    )
    section.table(_summary(results))
    _add_plots(section, [one for one in results if not one.error], reference)
    felt = any(one.number("force_error_n") is not None for one in results)
    for title, metrics in _TABLES.items():
        if metrics is _FORCES and not felt:
            continue
        columns = _columns(metrics)
        note = f"Medians over recordings. {_FORCE_NOTE if metrics is _FORCES else ''}"
        table = policy_table({"": runs}, columns, note.strip())
        section.table(table, folded=title)

    nlpd = _MEASURES["nlpd"]
    scores = [{one.task.seed: nlpd.of(one) for one in own} for own in runs.values()]
    table = Table(
        columns=("left out", *map(code, runs)),
        rows=tuple(
            (str(number), *(nlpd.text(own.get(number)) for own in scores))
            for number in sorted({one.task.seed for one in results})
        ),
        note="Recordings are numbered from 0 in the order of the file.",
    )
    section.table(table, folded="NLPD recording by recording")
    return section


def overview(results: Results) -> str:
    """Return the headlines of all methods as a table of plain text, best first."""
    table = _summary(results)
    # Plain text has neither marks nor line breaks within a cell.
    rows = tuple(
        (row[0].replace("`", "").replace("\n", ", "), *row[1:]) for row in table.rows
    )
    return text_table(replace(table, rows=rows))


def _summary(results: Results) -> Table:
    """Return the headlines of all methods, ordered by likelihood."""

    def likelihood(item: tuple[str, Results]) -> float:
        middle = _MEASURES["nlpd"].median(one for one in item[1] if not one.error)
        return math.inf if middle is None else middle

    order = sorted(by_policy(results).items(), key=likelihood)
    note = (
        "Medians over recordings. **n:** recordings left out, one at a time. "
        "**NLPD:** negative log predictive density of the outputs that move; less is "
        "better. **Position, rotation:** error of the prediction. **Inside 95 %:** "
        "share of the recording inside the stated 95 % intervals, 0.95 is correct. "
        "**After 25 %:** error and NLPD of the rest once a quarter has been seen. "
        "**Online 25 %:** the same, with the phase estimated from the samples so far."
    )
    return policy_table({"": dict(order)}, _columns(_SUMMARY), note)


def _columns(metrics: Iterable[str]) -> dict[str, Cell]:
    """Return a column with the number of results, and one with each median."""
    columns: dict[str, Cell] = {"n": lambda own: str(len(own))}
    for name in metrics:
        columns |= medians(_MEASURES[name])
    return columns


def _add_plots(section: Section, tests: Sequence[LeftOut], reference: str) -> None:
    """Add plots of coverage and errors of predictions, if there is a test."""
    runs = by_policy(tests)
    if any(one.number("coverage_95") is not None for one in tests):
        section.picture(
            "coverage",
            partial(coverage, runs, reference),
            "**Calibration of the predicted uncertainty.** Share of left-out numbers "
            "inside intervals of nominally 50, 90 and 95 %. Below the grey line the "
            f"intervals are too narrow. Violet: {code(reference)}.",
            "Measured against nominal coverage, a panel per policy",
        )
    if tests:
        section.picture(
            "skill",
            partial(prediction_scores, runs),
            "**Errors and likelihood of predictions.** A dot per test, a bar at the "
            "median; left is better. The policy with the least position error is on "
            "top.",
            "Dot plot of NLPD, position and rotation error by policy",
        )


def table_one_section(tests: Sequence[LearningTestResult]) -> Section:
    """The paper's rows and methods, measured marks, and differences."""
    section = Section("Table 1 of the paper, measured", "table-1")
    own = dict.fromkeys(one.policy for one in tests if one.policy_source)
    measured, tuned = _measured(tests, (*TABLE_1, *own)), _measured(tests, _TUNED)
    if not measured:
        section.say(
            "No policy of the paper's Table 1 has a learning test with a result in "
            "this study, so there is no number behind any mark."
        )
        return section
    note = (
        "✓ and ✗: whether the number earns the mark by the limits below; where the "
        "paper says otherwise, its own mark is given. Means over "
        f"{max(map(len, measured.values()))} learning tests. "
        "The paper's column GP is `local-gp` and `wishart-gp`, its last one "
        "`gp-paper` as published and `gp` as developed here."
    )
    section.table(_marks(measured, note), folded="Marks with their numbers")
    section.table(
        Table(
            columns=("row", "what is measured"),
            rows=tuple((item.row, item.sentence) for item in CRITERIA.values()),
            left=True,
        ),
        folded="What the rows mean",
    )
    if tuned:
        note = "The same with the settings that `gplfd tune` found for each method."
        section.table(_marks(tuned, note), folded="Marks of the tuned methods")
    return section


def _measured(tests: Sequence[LearningTestResult], shown: Sequence[str]) -> Metrics:
    """Metrics of some policies under the standard condition."""
    ran = (one for one in tests if not one.error and one.policy in shown)
    standard = by_policy(next(iter(by_condition(ran).values()), []))
    return {
        policy: [one.metrics for one in standard[policy]]
        for policy in shown
        if policy in standard
    }


def _marks(measured: Metrics, note: str) -> Table:
    """Return a row per criterion with a mark and a number per policy."""
    rows: list[tuple[str, ...]] = []
    for row, criterion in CRITERIA.items():
        limit = criterion.limits[0]
        bounded = limit.high < math.inf
        bound = f"≤ {limit.high:g}" if bounded else f"≥ {limit.low:g}"
        cells = [f"{row}\n{limit.symbol} {bound}"]
        for policy, own in measured.items():
            found, published = mark(criterion, own), policy in criterion.paper
            text, value = _SIGN[found.passed], found.value
            if value is not None and 0.0 < abs(value) < _TINY:
                text += f" < {_TINY:g}" if value > 0.0 else f" > −{_TINY:g}"
            elif value is not None:
                text += f" {value:.3g}".replace("-", "−")
            if policy in TABLE_1 and found.passed not in (None, published):
                text = f"**{text}**\n(paper {_SIGN[published]})"
            cells.append(text)
        rows.append(tuple(cells))
    return Table(columns=("", *map(code, measured)), rows=tuple(rows), note=note)
