"""Marks of Table 1 follow from numbers."""

import math

import pytest

from gplfd_experiments.studies.learning_tests.criteria import (
    CRITERIA,
    Criterion,
    Limit,
    mark,
)
from gplfd_policies.registry.built_in import TABLE_1

ROW = Criterion(
    row="Made up",
    limits=(
        Limit(metric="error", symbol="error", high=2.0),
        Limit(metric="share", symbol="share", low=0.5),
    ),
    sentence="Small errors and a large share.",
    absent="has no errors",
    paper=frozenset(),
)


@pytest.mark.parametrize(
    ("tasks", "passed", "value"),
    [
        ([{"error": 1.0, "share": 0.5}, {"error": 3.0, "share": 0.5}], True, 2.0),
        ([{"error": 1.0, "share": 0.5}, {"error": 3.1, "share": 0.5}], False, 2.05),
        ([{"error": 1.0, "share": 0.49}], False, 1.0),
        ([{"error": None, "share": 0.9}, {"error": 1.0, "share": 0.9}], True, 1.0),
        ([{"error": None, "share": 0.9}], False, None),
        ([{"share": 0.9}], None, None),
        ([], None, None),
    ],
)
def test_mark_is_the_mean_compared_with_all_limits(tasks, passed, value):
    result = mark(ROW, tasks)
    assert result.passed is passed
    assert result.value == (None if value is None else pytest.approx(value))


def test_text_of_a_mark_has_its_numbers_or_why_there_are_none():
    assert mark(ROW, [{"error": 1.2345, "share": 0.5}]).text == "error 1.23, share 0.5"
    assert mark(ROW, [{"error": None, "share": 0.5}]).text == "has no errors"
    assert mark(ROW, [{"share": 0.5}]).text == "not measured"
    with pytest.raises(ValueError, match="no criterion 'Speed'; rows: High-dim"):
        mark("Speed", [])


@pytest.mark.parametrize(
    ("policies", "marks"),
    [
        (("dmp",), "-----x"),
        (("promp",), "-xx--x"),
        (("gmr",), "x-x--x"),
        (("local-gp", "wishart-gp"), "x-xxx-"),
        (("kmp",), "xxxx-x"),
        (("gmm-gp",), "xxxxx-"),
        (("gp-paper", "gp"), "xxxxxx"),
    ],
)
def test_rows_and_columns_are_those_of_the_paper(policies, marks):
    assert list(CRITERIA) == [
        *("High-dimensional Learning", "Via-point Adaptation", "Task Variability"),
        *("Prediction Uncertainty", "Prior Information", "Task Space Rotations"),
    ]
    for policy in policies:
        assert policy in TABLE_1
        column = ["x" if policy in c.paper else "-" for c in CRITERIA.values()]
        assert "".join(column) == marks


def test_every_criterion_can_be_passed_and_failed():
    for criterion in CRITERIA.values():
        for limit in criterion.limits:
            assert limit.low > -math.inf or limit.high < math.inf
        good = {
            limit.metric: limit.low if limit.low > -math.inf else limit.high
            for limit in criterion.limits
        }
        bad = {
            name: value + (-1e-6 if limit.low > -math.inf else 1e-6)
            for limit, (name, value) in zip(criterion.limits, good.items(), strict=True)
        }
        assert mark(criterion.row, [good]).passed is True
        for name in good:
            assert mark(criterion.row, [{**good, name: bad[name]}]).passed is False
