"""Tables of a study and of a run, and how tables are written."""

import pytest
from scipy.stats import binomtest

from gplfd_env.doors.config import DOORS
from gplfd_experiments.analysis.results.grouping import (
    by_door_kind,
    counted,
    numbers,
    ranked,
)
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import (
    paired,
    signed_rank,
    success_rate,
)
from gplfd_experiments.analysis.results.table import remarks, run_table, study_table
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.files.table import Table, markdown_table, text_table

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


def test_cells_stay_apart_in_markdown():
    assert markdown_table(SMALL).splitlines() == [
        "| name | a\\|b<br>[m] |",
        "| :-- | --: |",
        "| x | 1 |",
        "| long | 2.5<br>more |",
    ]
    left = Table(columns=("a", "b"), rows=(), left=True)
    assert markdown_table(left).splitlines()[1] == "| :-- | :-- |"


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


def test_reasons_of_closed_doors_are_counted(rows, episode_result):
    closed = [episode_result("gp", seed, opened=False) for seed in range(3)]
    closed[1]["metrics"] |= {"failure": "grasp_lost", "reason": "out_of_reach"}
    row = rows(*closed, episode_result("gp", 3), episode_result("kmp"))
    assert row["gp", "0.5"]["not opened because"] == (
        "2 × door did not move further, "
        "1 × hand lost the handle: an arm joint was at its limit"
    )
    assert row["kmp", "0.5"]["not opened because"] == ""


def test_results_from_before_wall_times_are_read(rows, episode_result):
    old = episode_result("gp")
    for name in [one for one in old["metrics"] if one.startswith("latency_wall_")]:
        del old["metrics"][name]
    row = rows(old)["gp", "0.5"]
    assert row["CPU time per decision [ms]"] == "0.20"
    assert row["wall time per decision [ms]"] == "–"


def raised(result):
    """The same episode, had the policy raised an error."""
    return {**result, "error": "ValueError: x", "traceback": "Traceback ..."}


def gone(result):
    """The same episode, had its worker been killed."""
    return {**result, "error": "its worker died", "traceback": ""}


@pytest.fixture
def episodes_of(write_study):
    return lambda *results: read_results(write_study(results)).episodes


def test_an_error_of_the_policy_is_a_door_not_opened(rows, episodes_of, episode_result):
    # One policy opens what it tries and raises at the other doors; one tries them all.
    results = [
        *(episode_result("picky", seed, radial=1.0) for seed in range(4)),
        *(raised(episode_result("picky", seed)) for seed in range(4, 8)),
        *(episode_result("tries", seed, radial=9.0) for seed in range(6)),
        *(episode_result("tries", seed, opened=False) for seed in range(6, 8)),
        raised(episode_result("broken")),
    ]
    table = rows(*results)
    assert table["picky", "0.5"]["opened"] == "4/8"
    assert (
        table["picky", "0.5"]["95 %"]
        == success_rate((seed, seed < 4) for seed in range(8)).interval
    )
    assert table["picky", "0.5"]["errors"] == "4"
    assert table["picky", "0.5"]["radial force [N]"] == "1.0"
    assert (table["tries", "0.5"]["opened"], table["tries", "0.5"]["errors"]) == (
        "6/8",
        "0",
    )
    assert table["broken", "0.5"]["opened"] == "0/1"
    assert table["broken", "0.5"]["radial force [N]"] == "–"
    episodes = episodes_of(*results)
    assert remarks(episodes) == [
        "5 of 17 episodes ended in an error of the policy and count as not opened: "
        "broken 1, picky 4."
    ]
    assert [*ranked(episodes)] == ["tries", "picky", "broken"]
    one = next(one for one in episodes if one.policy == "broken")
    assert (one.solved, one.opened(15), one.metrics["failure"]) == (
        False,
        False,
        "policy_error",
    )


def test_what_the_machine_lost_counts_nowhere(rows, episodes_of, episode_result):
    results = [
        episode_result("gp", 0),
        gone(episode_result("gp", 1)),
        gone(episode_result("kmp", 0)),
    ]
    table = rows(*results)
    assert table["gp", "0.5"]["opened"] == "1/1"
    assert table["kmp", "0.5"]["opened"] == "0/0"
    episodes = episodes_of(*results)
    (said,) = remarks(episodes)
    assert said.startswith("2 of 3 episodes were lost, because the machine failed, and")
    assert [*ranked(episodes)] == ["gp", "kmp"]
    assert counted({"gp": episodes[:2]}) == {"gp": [episodes[0]]}


def test_paired_comparisons_know_errors(episodes_of, episode_result):
    results = [
        *(episode_result("gp", seed) for seed in range(8)),
        *(raised(episode_result("kmp", seed)) for seed in range(7)),
        gone(episode_result("kmp", 7)),
    ]
    runs = counted(ranked(episodes_of(*results)))
    opened = {
        policy: {one.key: float(one.opened()) for one in own}
        for policy, own in runs.items()
    }
    pairs = paired(opened["gp"], opened["kmp"])
    assert pairs.seeds == tuple(range(7))
    assert (set(pairs.first), set(pairs.second)) == ({1.0}, {0.0})
    assert signed_rank(*pairs.per_seed()) < 0.05
    # There is no force where nothing was felt.
    assert numbers(runs, EPISODE_MEASURES["force_radial_peak"])["kmp"] == {}


def test_what_all_is_measured_needs_no_remark(episodes_of, episode_result):
    assert remarks(episodes_of(*[episode_result("gp")] * 3)) == []


def test_metrics_that_older_results_lack_are_named(episodes_of, episode_result):
    older = episode_result("gp", 1)
    for name in ("capability", "stage"):
        del older["metrics"][name]
    episodes = episodes_of(episode_result("gp", 0), older)
    assert remarks(episodes) == [
        "1 of 2 episodes were made by an earlier version and lack metrics that were "
        "added since: capability, stage."
    ]
    assert [one.number("capability") for one in episodes] == [6, None]


def test_doors_are_in_groups_of_their_kind(episodes_of, episode_result):
    room = DOORS["room-834"]
    door = {"door": "room-834", "door_config": room.as_dict()}
    results = [
        episode_result(policy, radius=radius, **task)
        for policy in ("gp", "kmp")
        for radius, task in ((0.5, {}), (room.radius, door))
    ]
    episodes = episodes_of(*results)
    kinds = by_door_kind(episodes)
    assert [*kinds] == ["bar, pull", "lever with spring latch, pull"]
    assert [len(own) for own in kinds.values()] == [2, 2]
    assert [row[:2] for row in study_table(episodes).rows] == [
        ("**bar, pull**", ""),
        ("gp", "0.5"),
        ("kmp", "0.5"),
        ("**lever with spring latch, pull**", ""),
        ("gp", "room-834"),
        ("kmp", "room-834"),
    ]


def test_a_run_has_a_row_per_door(make_log):
    metrics = [
        episode_metrics(make_log(door="small")),
        episode_metrics(
            make_log(
                door="large",
                success=False,
                failure="grasp_lost",
                reason="handle_lost",
            )
        ),
    ]
    lines = text_table(run_table(metrics)).splitlines()
    assert lines[0].split()[:5] == ["door", "opened", "radius", "angle", "to"]
    assert lines[1].split()[:3] == ["[m]", "[°]", "[s]"]
    assert lines[4].split()[:4] == ["small", "yes", "0.50", "66.0"]
    assert lines[5].split()[:2] == ["large", "no"]
    assert lines[5].endswith("hand lost the handle")
    assert "because" not in text_table(run_table(metrics[:1]))


def test_brackets_beside_brackets_are_no_link() -> None:
    table = Table(columns=("√E[ε²] [mm]",), rows=(("[a](b) [1]",),))
    head, _, row = markdown_table(table).splitlines()
    assert head == r"| √E[ε²] \[mm] |"
    assert row == "| [a](b) [1] |"
