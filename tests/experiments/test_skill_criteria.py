"""Marks of Table 1 follow from numbers."""

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
    paper=frozenset(),
)
COLUMNS = {
    ("dmp",): "-----x",
    ("promp",): "-xx--x",
    ("gmr",): "x-x--x",
    ("local-gp", "wishart-gp"): "x-xxx-",
    ("kmp",): "xxxx-x",
    ("gmm-gp",): "xxxxx-",
    ("gp-paper", "gp"): "xxxxxx",
}
"""The paper's marks of methods, in the order of its rows."""


@pytest.mark.parametrize(
    ("tasks", "passed", "value"),
    [
        ([(1.0, 0.5), (3.0, 0.5)], True, 2.0),
        ([(1.0, 0.5), (3.1, 0.5)], False, 2.05),
        ([(1.2345, 0.49)], False, 1.2345),
        ([(None, 0.9), (1.0, 0.9)], True, 1.0),
        ([(None, 0.9)], False, None),
        ([(0.9,)], None, None),
        ([], None, None),
    ],
)
def test_mark_is_the_mean_compared_with_all_limits(tasks, passed, value):
    named = [dict(zip(("share", "error"), one[::-1], strict=False)) for one in tasks]
    assert mark(ROW, named) == (None if value is None else pytest.approx(value), passed)


def test_rows_and_columns_are_those_of_the_paper():
    assert list(CRITERIA) == [
        "High-dimensional Learning",
        "Via-point Adaptation",
        "Task Variability",
        "Prediction Uncertainty",
        "Prior Information",
        "Task Space Rotations",
    ]
    assert all(row == criterion.row for row, criterion in CRITERIA.items())
    for policies, marks in COLUMNS.items():
        for policy in policies:
            assert policy in TABLE_1
            column = ["x" if policy in c.paper else "-" for c in CRITERIA.values()]
            assert "".join(column) == marks, policy
