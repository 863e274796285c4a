"""Tables of a study and of a run, and how tables are written."""

import pytest

from gplfd_env.doors.config import DOORS
from gplfd_experiments.analysis.results.measures import (
    EPISODE_MEASURES,
    ranked,
    remarks,
    run_table,
    study_rows,
    study_table,
)
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import success_rate
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.files.table import FIRST, Table, markdown_table, text_table

SMALL = Table(columns=("name", "a|b\n[m]"), rows=(("x", "1"), ("long", "2.5\nmore")))
RAISED = {"error": "ValueError: x", "traceback": "Traceback ..."}
"""Of an episode in which the policy raised an error."""
LOST = {"error": "its worker died", "traceback": "", "lost": True}
"""Of one whose worker was killed."""


def test_columns_are_aligned_as_text_and_apart_in_markdown():
    assert text_table(SMALL).splitlines() == [
        "name   a|b",
        "       [m]",
        "x        1",
        "long   2.5",
        "      more",
    ]
    assert markdown_table(SMALL).splitlines() == [
        "| name | a\\|b<br>[m] |",
        "| :-- | --: |",
        "| x | 1 |",
        "| long | 2.5<br>more |",
    ]
    # Brackets beside brackets are no link.
    left = Table(columns=("√E[ε²] [mm]", "b"), rows=(("[a](b) [1]", ""),), left=True)
    head, rule, row = markdown_table(left).splitlines()
    assert (head, rule) == (r"| √E[ε²] \[mm] | b |", "| :-- | :-- |")
    assert row.startswith("| [a](b) [1] |")


@pytest.fixture
def episodes_of(write_study):
    return lambda *results: read_results(write_study(results)).episodes


def cells(episodes):
    """The table of episodes, by policy: cells by column."""
    table = study_table(study_rows(episodes))
    return {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}


def test_numbers_are_medians_and_reasons_are_counted(episodes_of, episode_result):
    opened = [
        episode_result("gp", n, radial=force - 0.01 * n)
        for n, force in enumerate((1.0, 3.0, 8.0))
    ]
    closed = [episode_result("gp", n, opened=False, radial=99.0) for n in range(3, 6)]
    closed[1]["metrics"] |= {"failure": "grasp_lost", "reason": "out_of_reach"}
    rows = cells(episodes_of(*opened, *closed, episode_result("kmp")))
    expected = {
        "opened": "3/6",
        "95 %": success_rate((n, n < 3) for n in range(6)).interval,
        "radial force [N]": "3.0",
        "√E[ε²] [mm]": "10.0",
        "governed [%]": "5.5",
        "CPU time per decision [ms]": "0.20",
        "not opened because": "2 × door did not move further, "
        "1 × hand lost the handle: an arm joint was at its limit",
    }
    assert expected.items() <= rows["gp"].items()
    assert rows["kmp"]["not opened because"] == ""


def test_an_error_of_the_policy_is_a_door_not_opened(episodes_of, episode_result):
    # One policy opens what it tries and raises at the other doors; one tries them all.
    episodes = episodes_of(
        *(episode_result("picky", seed, radial=1.0) for seed in range(4)),
        *({**episode_result("picky", seed), **RAISED} for seed in range(4, 8)),
        *(episode_result("tries", seed, radial=9.0) for seed in range(6)),
        *(episode_result("tries", seed, opened=False) for seed in range(6, 8)),
        {**episode_result("broken"), **RAISED},
    )
    table = cells(episodes)
    interval = success_rate((seed, seed < 4) for seed in range(8)).interval
    heads = ("opened", "95 %", "errors", "radial force [N]")
    assert [table["picky"][head] for head in heads] == ["4/8", interval, "4", "1.0"]
    assert [table["tries"][head] for head in ("opened", "errors")] == ["6/8", "0"]
    assert [table["broken"][head] for head in heads[::3]] == ["0/1", "–"]
    assert remarks(episodes) == [
        "5 of 17 episodes ended in an error of the policy and count as not opened: "
        "broken 1, picky 4."
    ]
    assert [*ranked(episodes)] == ["tries", "picky", "broken"]
    broken = next(episode for episode in episodes if episode.policy == "broken")
    assert (broken.solved, broken.opened(15)) == (False, False)
    assert broken.metrics["failure"] == "policy_error"
    # There is no force where nothing was felt.
    force = EPISODE_MEASURES["force_radial_peak"]
    assert len(force.values(episodes)) == 10


def test_what_the_machine_lost_counts_nowhere(episodes_of, episode_result):
    lost = [{**episode_result(policy, 1), **LOST} for policy in ("gp", "kmp")]
    episodes = episodes_of(episode_result("gp"), *lost)
    table = cells(episodes)
    assert [table[policy]["opened"] for policy in ("gp", "kmp")] == ["1/1", "0/0"]
    (remark,) = remarks(episodes)
    assert remark.startswith("2 of 3 episodes were lost, as the machine failed,")
    assert [*ranked(episodes)] == ["gp", "kmp"]


def test_doors_are_in_groups_of_their_kind(episodes_of, episode_result):
    room = DOORS["room-834"]
    door = {"door": "room-834", "door_config": room.as_dict()}
    results = [
        episode_result(policy, radius=radius, **task)
        for policy in ("gp", "kmp")
        for radius, task in ((0.5, {}), (room.radius, door))
    ]
    table = study_table(study_rows(episodes_of(*results)))
    assert [row[:2] for row in table.rows] == [
        ("**bar, pull**", ""),
        ("gp", "0.5"),
        ("kmp", "0.5"),
        ("**lever with spring latch, pull**", ""),
        ("gp", "room-834"),
        ("kmp", "room-834"),
    ]


def test_a_run_has_a_row_per_door(make_log):
    failed = {"success": False, "failure": "grasp_lost", "reason": "handle_lost"}
    logs = make_log(door="small"), make_log(door="large", **failed)
    metrics = [*map(episode_metrics, logs)]
    lines = text_table(run_table(metrics), FIRST).splitlines()
    assert lines[0].split()[:5] == ["door", "opened", "angle", "radial", "force"]
    assert lines[1].split()[:2] == ["[°]", "[N]"]
    assert lines[2].split()[:3] == ["small", "yes", "66.0"]
    assert lines[3].split()[:2] == ["large", "no"]
    assert lines[3].endswith("hand lost the handle")
    (_, *columns), (_, *row) = run_table(metrics).columns, run_table(metrics).rows[0]
    assert (len(columns), row[columns.index("radius\n[m]")]) == (11, "0.50")
    assert "because" not in text_table(run_table(metrics[:1]))
