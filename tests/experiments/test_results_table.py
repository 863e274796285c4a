"""Tables of a study and of a run, and how tables are written."""

import pytest
from scipy.stats import binomtest

from gplfd.experiments.episodes.metrics import episode_metrics
from gplfd.experiments.files.table import Table, html_table, markdown_table, text_table
from gplfd.experiments.results.reading import read_results
from gplfd.experiments.results.statistics import success_rate
from gplfd.experiments.results.table import error_count, run_table, study_table

SMALL = Table(columns=("name", "a|b\n[m]"), rows=(("x", "1"), ("long", "2.5\nmore")))


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 20), (1, 3), (19, 20), (20, 20), (57, 60)]
)
def test_wilson_interval_is_the_formula(successes, trials):
    found = success_rate((seed, seed < successes) for seed in range(trials))
    low, high = found.low, found.high
    z, rate = 1.959963984540054, successes / trials
    for bound in (low, high):
        # The bounds are the rates from which the score is z away.
        score = (rate - bound) ** 2 * trials
        assert score == pytest.approx(z**2 * bound * (1.0 - bound), abs=1e-12)
    assert low <= rate <= high
    exact = binomtest(successes, trials).proportion_ci(method="exact")
    assert exact.low <= low + 0.01 <= high <= exact.high + 0.01


def test_text_is_aligned_and_a_second_line_stands_below():
    assert text_table(SMALL).splitlines() == [
        "name   a|b",
        "       [m]",
        "x        1",
        "long   2.5",
        "      more",
    ]


def test_cells_stay_apart_in_markdown_and_html():
    assert markdown_table(SMALL).splitlines() == [
        "| name | a\\|b<br>[m] |",
        "| :-- | --: |",
        "| x | 1 |",
        "| long | 2.5<br>more |",
    ]
    page = html_table(SMALL, str.upper)
    assert "<td>LONG</td><td>2.5<br><small>MORE</small></td>" in page
    left = Table(columns=("a", "b"), rows=(), left=True)
    assert markdown_table(left).splitlines()[1] == "| :-- | :-- |"
    assert html_table(left, str).startswith('<table class="text">')


@pytest.fixture
def rows(write_study):
    """The table of some results, by policy and door: cells by column."""

    def tabulate(*results):
        table = study_table(read_results(write_study(results)).episodes)
        cells = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
        return {(each["policy"], each["door"]): each for each in cells}

    return tabulate


def test_forces_are_medians_over_successes(rows, episode_result):
    closed = episode_result("gp", 3, opened=False, radial=99.0)
    opened = [
        episode_result("gp", n, radial=force - 0.01 * n)
        for n, force in enumerate((1.0, 3.0, 8.0))
    ]
    row = rows(*opened, closed)["gp", "0.5"]
    assert row["opened"] == "3/4"
    assert row["95 %"] == "0.30–0.95"
    assert row["radial force [N]"] == "3.0"
    assert row["√E[ε²] [mm]"] == "10.0"
    assert row["governed [%]"] == "5.5"
    assert row["CPU time per decision [ms]"] == "0.20"


def test_the_table_says_why_doors_stayed_closed(rows, episode_result):
    closed = episode_result("gp", 3, opened=False)
    closed["metrics"]["reason"] = "too_heavy"
    lost = episode_result("gp", 4, opened=False)
    lost["metrics"] |= {"failure": "grasp_lost", "reason": "handle_lost"}
    assert "not opened because" not in rows(episode_result("gp"))["gp", "0.5"]
    table = rows(closed, closed | {"task": {**closed["task"], "seed": 5}}, lost)
    why = table["gp", "0.5"]["not opened because"]
    assert why == "2 × stalled (too heavy), 1 × grasp lost"


def test_an_error_counts_neither_as_opened_nor_as_closed(
    rows, episode_result, write_study
):
    broken = {**episode_result("gp", 1), "error": "x"}
    results = (episode_result("gp"), broken, {**episode_result("kmp"), "error": "x"})
    table = rows(*results)
    assert table["gp", "0.5"]["opened"] == "1/1"
    assert table["kmp", "0.5"]["opened"] == "0/0"
    assert table["kmp", "0.5"]["radial force [N]"] == "–"
    assert error_count(read_results(write_study(results)).episodes) == (
        "2 of 3 episodes ended in an error and count neither as opened nor as closed: "
        "gp 1, kmp 1."
    )
    assert (
        error_count(read_results(write_study([episode_result("gp")] * 3)).episodes)
        == ""
    )


def test_a_run_has_a_row_per_door(make_log):
    metrics = [
        episode_metrics(make_log(door="small")),
        episode_metrics(make_log(door="large", success=False, failure="grasp_lost")),
    ]
    lines = text_table(run_table(metrics)).splitlines()
    assert lines[0].split()[:5] == ["door", "opened", "radius", "angle", "to"]
    assert lines[1].split()[:3] == ["[m]", "[°]", "[s]"]
    assert lines[4].split()[:4] == ["small", "yes", "0.50", "66.0"]
    assert lines[5].startswith("large  grasp lost")
    assert len({line.rfind(" ") for line in lines[4:]}) == 1


def test_brackets_beside_brackets_are_no_link() -> None:
    table = Table(columns=("√E[ε²] [mm]",), rows=(("[a](b) [1]",),))
    head, _, row = markdown_table(table).splitlines()
    assert head == r"| √E[ε²] \[mm] |"
    assert row == "| [a](b) [1] |"
