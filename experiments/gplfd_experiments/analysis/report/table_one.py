"""Table 1 of the paper with a measured number behind every mark.

The paper is Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979. What is measured, and what it must be for a mark, is
said in `gplfd_experiments.studies.learning_tests.criteria`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from gplfd_experiments.analysis.report.document import Section, code, names
from gplfd_experiments.analysis.results.grouping import by_condition, by_policy
from gplfd_experiments.analysis.results.records import LearningTestResult
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.learning_tests.criteria import (
    CRITERIA,
    Criterion,
    Mark,
    mark,
)
from gplfd_policies.registry.built_in import TABLE_1

_SIGN: Final = {True: "✓", False: "✗", None: "?"}
_TUNED: Final = tuple(f"{policy}-tuned" for policy in TABLE_1)
_TINY: Final = 1e-3
"""Smaller numbers are shown as being so."""

Metrics = dict[str, list[Mapping[str, Any]]]
"""Those of every learning test, by policy."""
Marks = Mapping[str, Mapping[str, Mark]]
"""By row of the table and policy."""


def table_one_section(tests: Sequence[LearningTestResult]) -> Section:
    """The paper's rows and methods, our marks, and where the two disagree."""
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
    if missing := [policy for policy in TABLE_1 if policy not in measured]:
        note += f" Not in this study, or only with errors: {names(missing)}."
    marks = _marks(measured)
    section.table(_table(marks, note), folded="Marks with their numbers")
    judged = [
        _disagrees(CRITERIA[row], policy, found)
        for row, own_marks in marks.items()
        for policy, found in own_marks.items()
        if found.passed is not None and policy in TABLE_1
    ]
    section.say(
        f"Measurement and paper disagree in {sum(judged)} of {len(judged)} marks. "
        "The paper judges what was published about a method; here one "
        "implementation of it is measured on one task."
    )
    section.items(_explained(CRITERIA[row], marks[row]) for row in CRITERIA)
    if tuned:
        note = "The same with the settings that `gplfd tune` found for each method."
        table = _table(_marks(tuned), note)
        section.table(table, folded="Marks of the tuned methods")
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


def _marks(measured: Metrics) -> Marks:
    return {
        row: {policy: mark(row, own) for policy, own in measured.items()}
        for row in CRITERIA
    }


def _table(marks: Marks, note: str) -> Table:
    """Return a row per criterion with a mark and a number per policy."""

    def cell(criterion: Criterion, policy: str, found: Mark) -> str:
        text, value = _SIGN[found.passed], found.value
        if value is not None and 0.0 < abs(value) < _TINY:
            text += f" < {_TINY:g}" if value > 0.0 else f" > −{_TINY:g}"
        elif value is not None:
            text += f" {value:.3g}".replace("-", "−")
        if _disagrees(criterion, policy, found):
            text = f"**{text}**\n(paper {_SIGN[policy in criterion.paper]})"
        return text

    rows = []
    for row, criterion in CRITERIA.items():
        limit = criterion.limits[0]
        bounded = limit.high < math.inf
        bound = f"≤ {limit.high:g}" if bounded else f"≥ {limit.low:g}"
        cells = (cell(criterion, *item) for item in marks[row].items())
        rows.append((f"{row}\n{limit.symbol} {bound}", *cells))
    policies = next(iter(marks.values()))
    return Table(columns=("", *map(code, policies)), rows=tuple(rows), note=note)


def _disagrees(criterion: Criterion, policy: str, found: Mark) -> bool:
    judged = found.passed is not None and policy in TABLE_1
    return judged and found.passed != (policy in criterion.paper)


def _explained(criterion: Criterion, marks: Mapping[str, Mark]) -> str:
    """Return the criterion, and the numbers where the paper says otherwise."""
    text = f"**{criterion.row}.** {criterion.sentence}"
    others: dict[tuple[bool | None, str], list[str]] = {}
    for policy, found in marks.items():
        if _disagrees(criterion, policy, found):
            others.setdefault((found.passed, found.text), []).append(policy)
    if not others:
        return f"{text} As in the paper."
    differing = "; ".join(
        f"{names(policies)} {_SIGN[passed]}, the paper {_SIGN[not passed]} ({numbers})"
        for (passed, numbers), policies in others.items()
    )
    return f"{text} Otherwise than in the paper: {differing}."
