"""Table 1 of the paper with a measured number behind every mark.

The paper is Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979. What is measured, and what it must be for a mark, is
said in `gplfd_experiments.studies.learning_tests.criteria`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from gplfd_experiments.analysis.report.document import (
    Block,
    Details,
    Items,
    Paragraph,
    Section,
    code,
    names,
)
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


def table_one_section(tests: Sequence[LearningTestResult]) -> Section:
    """The paper's rows and methods, our marks, and where the two disagree."""
    return Section(
        title="Table 1 of the paper, measured",
        anchor="table-1",
        blocks=tuple(_blocks(tests)),
    )


def _blocks(tests: Sequence[LearningTestResult]) -> list[Block]:
    own = dict.fromkeys(one.policy for one in tests if one.policy_source)
    measured, tuned = _measured(tests, (*TABLE_1, *own)), _measured(tests, _TUNED)
    if not measured:
        return [
            Paragraph(
                text="No policy of the paper's Table 1 has a learning test with a "
                "result in this study, so there is no number behind any mark."
            )
        ]
    missing = [policy for policy in TABLE_1 if policy not in measured]
    note = (
        "✓ and ✗: whether the number earns the mark by the limits below; where the "
        "paper says otherwise, its own mark is given. Means over "
        f"{max(map(len, measured.values()))} learning tests. "
        "The paper's column GP is `local-gp` and `wishart-gp`, its last one `gp-paper` "
        "to the letter and `gp` as developed here."
    )
    if missing:
        note += f" Not in this study, or only with errors: {names(missing)}."
    marks = _marks(measured)
    blocks: list[Block] = [
        Details(title="Marks with their numbers", table=_table(marks, note)),
        Paragraph(text=_summary(marks)),
        Items(texts=tuple(_explained(CRITERIA[row], marks[row]) for row in CRITERIA)),
    ]
    if tuned:
        note = "The same with the settings that `gplfd tune` found for each method."
        table = _table(_marks(tuned), note)
        blocks.append(Details(title="Marks of the tuned methods", table=table))
    return blocks


def _marks(measured: Metrics) -> dict[str, dict[str, Mark]]:
    return {
        row: {policy: mark(row, own) for policy, own in measured.items()}
        for row in CRITERIA
    }


def _table(marks: Mapping[str, Mapping[str, Mark]], note: str) -> Table:
    rows = tuple(
        (
            f"{row}\n{_limit(criterion)}",
            *(_cell(criterion, policy, found) for policy, found in marks[row].items()),
        )
        for row, criterion in CRITERIA.items()
    )
    policies = next(iter(marks.values()))
    return Table(columns=("", *map(code, policies)), rows=rows, note=note)


def _measured(tests: Sequence[LearningTestResult], shown: Sequence[str]) -> Metrics:
    """Metrics of some policies under the standard condition."""
    ran = [one for one in tests if not one.error]
    conditions = by_condition(one for one in ran if one.policy in shown)
    standard = by_policy(next(iter(conditions.values()), []))
    return {
        policy: [one.metrics for one in standard[policy]]
        for policy in shown
        if policy in standard
    }


def _cell(criterion: Criterion, policy: str, found: Mark) -> str:
    number = "" if found.value is None else f" {_number(found.value)}"
    text = f"{_SIGN[found.passed]}{number}"
    if _disagrees(criterion, policy, found):
        text = f"**{text}**\n(paper {_SIGN[policy in criterion.paper]})"
    return text


def _number(value: float) -> str:
    if 0.0 < abs(value) < _TINY:
        return f"< {_TINY:g}" if value > 0.0 else f"> −{_TINY:g}"
    return f"{value:.3g}".replace("-", "−")


def _limit(criterion: Criterion) -> str:
    """What the number of a row is, and what it must be."""
    limit = criterion.limits[0]
    if limit.high < math.inf:
        return f"{limit.symbol} ≤ {limit.high:g}"
    return f"{limit.symbol} ≥ {limit.low:g}"


def _disagrees(criterion: Criterion, policy: str, found: Mark) -> bool:
    judged = found.passed is not None and policy in TABLE_1
    return judged and found.passed != (policy in criterion.paper)


def _summary(marks: Mapping[str, Mapping[str, Mark]]) -> str:
    judged = [
        _disagrees(CRITERIA[row], policy, found)
        for row, own in marks.items()
        for policy, found in own.items()
        if found.passed is not None and policy in TABLE_1
    ]
    return (
        f"Measurement and paper disagree in {sum(judged)} of {len(judged)} marks. The "
        "paper judges what was published about a method; here one implementation of it "
        "is measured on one task."
    )


def _explained(criterion: Criterion, marks: Mapping[str, Mark]) -> str:
    """The criterion, and the numbers where the paper says otherwise."""
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
