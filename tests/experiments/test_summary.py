"""The table of a study."""

import pytest
from scipy.stats import binomtest

from experiments.results.table import COLUMNS, summary_table, wilson_interval


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 20), (1, 3), (19, 20), (20, 20), (57, 60)]
)
def test_wilson_interval_matches_scipy(successes, trials):
    expected = binomtest(successes, trials).proportion_ci(method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx(
        (expected.low, expected.high), abs=1e-12
    )


def result(success, radial, seed=0, **task):
    metrics = {
        "success": success,
        "time_to_60_deg": 5.0 if success else None,
        "force_radial_peak": radial,
        "force_tangential_peak": 2.0,
        "slip_max_mm": 1.0,
        "prediction_error_position": 1e-4,
        "governed_share": 0.01 * radial,
        "latency_median_ms": 0.2,
    }
    return {
        "task": {"policy": "gp", "door": "small", "seed": seed} | task,
        "metrics": metrics,
    }


def cells(table, row):
    line = table.splitlines()[2 + row]
    return dict(
        zip(COLUMNS, (cell.strip() for cell in line.split("|")[1:-1]), strict=True)
    )


def test_forces_are_medians_over_successes():
    table = summary_table(
        [result(True, 1.0), result(True, 3.0), result(True, 8.0), result(False, 99.0)]
    )
    row = cells(table, 0)
    assert row["opened"] == "3/4"
    assert row["radial force [N]"] == "3.0"
    assert row["√E[ε²] [mm]"] == "10.0"
    assert row["governed [%]"] == "5.5"


def test_an_error_counts_as_not_opened():
    broken = {"task": {"policy": "gp", "door": "small", "seed": 1}, "error": "x"}
    row = cells(summary_table([result(True, 1.0), broken]), 0)
    assert row["opened"] == "1/2"


def test_rows_are_policies_and_doors_in_the_order_they_came():
    table = summary_table(
        [result(True, 1.0, door="large"), result(False, 1.0, policy="oracle")]
    )
    assert cells(table, 0)["door"] == "large"
    assert cells(table, 1)["policy"] == "oracle"
    assert cells(table, 1)["to 60° [s]"] == "–"
