"""The report of constructed studies: what it says, and that it needs nothing else."""

import base64
import html.parser
import itertools
import json
import math
import re
from pathlib import Path

import pytest

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.report.document import Document, Section
from gplfd_experiments.analysis.report.page import report, write_report
from gplfd_experiments.analysis.report.writing import html_page, inline, markdown_page
from gplfd_experiments.analysis.results.measures import WALL_TIME
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import success_rate
from gplfd_experiments.cli import main as cli
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.learning_tests.criteria import CRITERIA

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_plots")]

VOID = {"meta", "img", "br", "link", "hr"}


@pytest.fixture
def policies(episode_result):
    """gp opens all, kmp opens the demonstrated radius only, dmp none."""
    return [
        result
        for seed in range(8)
        for radius in (0.5, 0.42)
        for result in (
            episode_result("gp", seed, radius),
            episode_result("kmp", seed, radius, radial=3.0, opened=radius == 0.5),
            episode_result("dmp", seed, radius, opened=False),
        )
    ]


def markdown(folder, reference="gp"):
    """The text alone: plots take their time."""
    return markdown_page(report(read_results(folder), folder, folder, reference))


@pytest.fixture
def page_of(write_study):
    """The text of the page of some results."""
    return lambda results, reference="gp": markdown(write_study(results), reference)


@pytest.fixture
def page(page_of, policies):
    """The text of the page of `policies`."""
    return page_of(policies)


LOST = {"error": "its worker was killed", "traceback": ""}
"""Of an episode whose worker was killed."""


def cells(text, title="## Doors opened"):
    """The first table after a title: cells by policy and head."""
    lines = text.partition(title)[2].splitlines()
    start = next(n for n, line in enumerate(lines) if line.startswith("| policy"))
    table = itertools.takewhile(lambda line: line.startswith("|"), lines[start:])
    heads, _, *rows = (line.strip("| ").split(" | ") for line in table)
    return {row[0].strip("`"): dict(zip(heads, row, strict=False)) for row in rows}


class Page(html.parser.HTMLParser):
    """Checks that elements nest, and collects what is referred to."""

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.anchors, self.tags = [], [], set(), set()
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attributes:
            if name in ("href", "src"):
                self.references.append(value)
            if name == "id":
                assert value not in self.anchors
                self.anchors.add(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_needs_nothing_else_and_equal_results_give_equal_bytes(
    write_study, tmp_path, policies, learning_result
):
    study = write_study([*policies, learning_result("gp"), learning_result("kmp")])
    results = read_results(study)
    for out in ("first", "second"):
        text = write_report(results, study, tmp_path / out).read_text()
    folder = tmp_path / "first"
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    assert len(files) == 12
    for file in files:
        other = tmp_path / "second" / file.relative_to(folder)
        assert file.read_bytes() == other.read_bytes(), file.name

    page = Page(text)
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert "width=device-width" in text
    assert not re.search(r"@import|url\(", text)
    for reference in page.references:
        if reference.startswith("#"):
            assert reference[1:] in page.anchors
        else:
            assert reference.startswith("data:image/svg+xml;base64,")
            svg = base64.b64decode(reference.partition(",")[2])
            assert b"<svg" in svg
            assert b'href="http' not in svg
    names = {path.stem for path in (folder / "figures").glob("*.svg")}
    assert names == {"success", "radial_force", "forecast", "coverage", "skill"}


def test_the_page_begins_with_a_summary_of_what_was_opened(
    write_study, page_of, policies, episode_result
):
    """Rates and forces by kind of radius, failures in words, errors as not opened."""
    broken = [{**episode_result("mine", seed), "error": "E: x"} for seed in range(3)]
    for result in policies:
        if result["task"]["policy"] == "kmp":
            result["metrics"]["reason"] = "too_heavy"
    text = page_of([*policies, *broken])
    summary, _, _ = text.partition("- **Doors opened to 60°:**")
    rows = cells(summary, "# Opening doors")
    assert len(rows["gp"]) <= 9
    known, new = "<br>demonstrated radii", "<br>new radii"
    assert rows["gp"] == {
        "policy": "`gp`",
        "seeds": "8",
        f"opened,{known}": "8/8<br>0.68–1.00",
        f"opened,{new}": "8/8<br>0.68–1.00",
        f"radial force [N],{known}": "1.0<br>1.0 to 1.1",
        f"radial force [N],{new}": "1.0<br>1.0 to 1.1",
        "not opened because": "",
        "errors": "0",
    }
    assert rows["kmp"][f"radial force [N],{new}"] == "none opened"
    assert (
        rows["kmp"]["not opened because"]
        == "8 × door did not move further: it took more than 20 N"
    )
    order = list(rows)
    assert order.index("kmp") < order.index("**opened no door (not ranked)**")
    assert order.index("**opened no door (not ranked)**") < order.index("dmp")
    assert rows["mine"][f"opened,{known}"].startswith("0/3<br>")
    assert (rows["mine"]["not opened because"], rows["mine"]["errors"]) == (
        "3 × policy raised an error",
        "3",
    )
    # What is wide is folded away.
    folded = html_page(
        report(read_results(write_study(policies)), Path(), Path(), "gp"),
        dict.fromkeys(("success", "radial_force", "forecast"), b""),
    )
    shown = re.sub(r"<details>.*?</details>", "", folded, flags=re.S)
    heads = re.findall(r"<thead>(.*?)</thead>", shown, re.S)
    assert max(head.count("<th ") for head in heads) <= 8
    assert len(heads) < len(re.findall(r"<thead>", folded))


def test_the_summary_groups_by_kind_of_door(page_of, episode_result):
    results = [episode_result("gp", seed) for seed in range(3)]
    pushed = [episode_result("gp", seed, door="pushed") for seed in range(3)]
    for result in pushed:
        result["task"]["door_config"]["swing"] = "push"
    text = page_of([*results, *pushed])
    summary = text.partition("- **Doors opened")[0]
    for kind in ("bar, pull", "bar, push"):
        assert summary.count(f"| **{kind}** |") == 1
    # Fewer than six seeds have no interval.
    assert "| 1.0 |" in summary


def test_a_door_that_slipped_away_is_opened_but_not_solved(
    page_of, policies, episode_result
):
    slipped = episode_result("gp", 50, 0.5)
    slipped["metrics"] |= {"success": False, "failure": "grasp_lost"}
    text = page_of([*policies, slipped])
    assert "**Doors opened to 60°:** `gp`, 17 of 17 (0.82–1.00), is best" in text
    held = "**Opened and held, the handle in the hand:** `gp`, 16 of 17 (0.62–0.99), is"
    assert held in text
    row = cells(text)["gp"]
    assert row["solved"].startswith("16/17<br>")
    assert row["to 60°"].startswith("17/17<br>")
    assert (row["grasp lost"], row["stalled"]) == ("1", "0")
    assert row["median angle<br>largest"].startswith("64.0°")
    # In the kind of door and in the door where it slipped.
    assert "| `gp` | 8/9<br>0.57–0.98 | 9/9" in text
    doors = cells(text, "**Door by door**")["gp"]
    assert doors["0.5"] == "8/9<br>0.57–0.98<br>to 60°: 9<br>1.0 N"
    assert doors["0.42"] == "8/8<br>0.68–1.00<br>1.0 N"


def test_errors_are_apart_and_come_first(write_study, policies, episode_result):
    broken = episode_result("gp", 99, 0.5)
    del broken["metrics"]
    broken["error"] = "ValueError: too <few> demonstrations"
    folder = write_study([*policies, broken])
    document = report(read_results(folder), folder, folder, "gp")
    text = markdown_page(document)
    first = text.splitlines()[2]
    assert first.startswith(
        "> **Mind:** 1 of 49 episodes ended in an error of the policy and count as not "
        "opened: gp 1."
    )
    assert "`gp`, 16 of 17 (0.62–0.99), is best" in text
    assert "| `gp`<br>errors: 1 | 16/17" in text
    assert cells(text)["gp`<br>errors: 1"]["policy error"] == "1"
    assert "1 × gp, 0.5: ValueError: too <few> demonstrations" in text
    images = {picture.name: b"" for picture in document.pictures}
    assert "too &lt;few&gt; demonstrations" in html_page(document, images)


def test_lost_episodes_count_nowhere_and_are_named(page_of, episode_result):
    results = [episode_result("gp", seed) for seed in range(8)]
    results += [{**episode_result("kmp", seed), **LOST} for seed in range(1, 8)]
    results += [episode_result("kmp"), {**episode_result("mine"), **LOST}]
    text = page_of(results)
    said = "`gp`, 8 of 8 (0.68–1.00), is best together with `kmp`"
    assert f"**Doors opened to 60°:** {said}" in text
    name, *row = cells(text)["mine`<br>lost: 1"].values()
    assert (name, set(row)) == ("`mine`<br>lost: 1", {"–"})


def test_parts_of_a_study_give_a_report(write_study, episode_result, learning_result):
    for results, expected in (
        ([episode_result("gp")], "nothing to compare"),
        ([learning_result("gp")], "1 learning tests of 1 policies"),
        ([{**episode_result("gp"), **LOST}], "`gp` has no episode that ran"),
        ([{**learning_result("kmp"), **LOST}], "no learning test with a result"),
    ):
        folder = write_study(results)
        write_report(read_results(folder), folder)
        text = (folder / "report.md").read_text()
        assert expected in text
        assert not re.findall(r"(?m)^- *$", text)


def test_any_policy_is_the_reference(write_study, policies):
    folder = write_study(policies)
    text = markdown(folder, "kmp")
    assert (
        "**Doors opened to 60°:** `kmp`, 8 of 16 (0.28–0.72), is beaten by `gp`" in text
    )
    assert "`kmp` against each other policy on the same doors and seeds" in text
    assert "| `gp` | 0 : 8<br>**p 0.016**, n 8 |" in text
    first, *_ = report(read_results(folder), folder, folder, "kmp").pictures
    panels = [axes for axes in first.draw().axes if axes.lines]
    marked = {
        axes.get_title(loc="left"): axes.lines[-1].get_color() == style.ADAPTED
        for axes in panels
    }
    assert marked == {"gp": False, "kmp": True, "dmp": False}


def test_without_the_reference_the_best_takes_its_place(page_of, policies):
    others = [one for one in policies if one["task"]["policy"] != "gp"]
    text = page_of(others)
    assert "`gp` is not in this study; `kmp` takes its place." in text
    assert (
        "**Doors opened to 60°:** `kmp`, 8 of 16 (0.28–0.72); no other policy opened"
        in text
    )


def test_radii_that_are_drawn_are_in_bands(page_of, policies, episode_result):
    drawn = [episode_result("gp", seed, 0.5, randomization="hard") for seed in range(3)]
    for result, radius in zip(drawn, (0.33, 0.36, 0.58), strict=True):
        result["metrics"]["radius"] = radius
    text = page_of([*policies, *drawn])
    condition = "2 demonstrations per door, teacher noise × 1, randomization hard"
    assert f"| **{condition}** |  |" in text
    assert f"| **new radii: {condition}** |  |" in text
    doors = text.partition("**Door by door**")[2]
    assert "| policy | 0.3–0.4 m | 0.42 | 0.5 | 0.5–0.6 m |" in doors
    assert "| `gp` | 2/2<br>0.34–1.00<br>1.0 N | – | – | 1/1<br>" in doors


def test_non_standard_doors_are_not_taken_for_demonstrated(
    page_of, policies, episode_result
):
    heavy = episode_result("gp", 0, 0.5, door="heavy")
    heavy["task"]["door_config"]["closer_preload"] = 5.0
    text = page_of([*policies, heavy])
    for kind, rate in (
        ("demonstrated radii", "8/8<br>0.68–1.00"),
        ("new radii", "8/8<br>0.68–1.00"),
        ("other doors", "1/1<br>0.21–1.00"),
    ):
        group = text.partition(f"| **{kind}** |")[2]
        assert group.splitlines()[1].startswith(f"| `gp` | {rate} |")


def judged(row, *, earned):
    """Metrics that just do or do not earn a mark."""
    metrics = {}
    for limit in CRITERIA[row].limits:
        high = limit.high < math.inf
        bound = limit.high if high else limit.low
        metrics[limit.metric] = bound * (0.5 if high == earned else 2.0)
    return metrics


def test_table_1_has_a_number_and_tells_where_the_paper_says_otherwise(
    write_study, learning_result
):
    via, growth = "Via-point Adaptation", "Prediction Uncertainty"
    good = {**judged(via, earned=True), **judged(growth, earned=True)}
    bad = {**judged(via, earned=False), **judged(growth, earned=False)}
    text = markdown(
        write_study([learning_result("gp", **good), learning_result("promp", **bad)])
    )
    rows = {
        line.split("<br>")[0].strip("| "): line
        for line in text.splitlines()
        if line.startswith("| ") and "<br>" in line
    }
    # The paper gives ProMP the first mark and not the second.
    wrong = CRITERIA[via].limits[0].high * 2.0
    assert f"| **✗ {wrong:.3g}**<br>(paper ✓) | ✓" in rows[via]
    assert re.search(r"\| ✗ [\d.]+ \| ✓ [\d.]+ \|$", rows[growth])
    assert re.search(r"`promp` ✗, the paper ✓ \(missed by", text)
    assert rows["Task Space Rotations"].endswith("| ? | ? |")
    assert "disagree in 2 of 8 marks" in text


def test_tuned_methods_have_a_table_of_their_own(page_of, learning_result):
    via = "Via-point Adaptation"
    results = [
        learning_result("promp", **judged(via, earned=False)),
        learning_result("promp-tuned", **judged(via, earned=True)),
    ]
    text = page_of(results)
    assert "settings that `gplfd tune` found" in text
    heads = [line for line in text.splitlines() if line.startswith("|  | `promp")]
    assert heads == ["|  | `promp` |", "|  | `promp-tuned` |"]
    rows = [line for line in text.splitlines() if line.startswith(f"| {via}<br>")]
    assert [("✗" in row, "✓" in row) for row in rows] == [(True, True), (False, True)]


def test_recordings_are_linked_from_where_the_page_is(
    write_study, tmp_path, episode_result
):
    folder = write_study([episode_result("gp")])
    recordings = folder / "recordings"
    recordings.mkdir()
    for name in ("gp-best.rrd", "comparison.rrd"):
        (recordings / name).write_bytes(b"")
    about = {"door": "0.5", "seed": 0, "repeated": False}
    different = {"slip_max_mm": [1.0, 2.0]}
    entries = [
        {"file": "gp-best.rrd", **about, "different": different},
        {"file": "gp-worst.rrd", **about, "error": "ValueError: gone"},
    ]
    (recordings / "index.json").write_text(json.dumps({"episodes": entries}))
    out = tmp_path / "elsewhere"
    write_report(read_results(folder), folder, out)
    text = (out / "report.md").read_text()
    assert "[comparison.rrd](../study/recordings/comparison.rrd)" in text
    assert (
        "[gp-best.rrd](../study/recordings/gp-best.rrd) 0.5, seed 0 (**differs" in text
    )
    assert "stored result:** slip max mm)" in text
    assert "| – | 0.5, seed 0 (**not repeated:** `ValueError: gone`) |" in text
    for link in re.findall(r"\((\S+\.rrd)\)", text):
        assert (out / link).resolve().is_file()


def test_wrong_folders_end_with_status_2(write_study, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    for folder, message in (
        (tmp_path / "absent", "there is no folder"),
        (empty, "is not the folder of a study: it has no tasks/*.json"),
    ):
        assert cli.main(["report", str(folder)]) == 2
        assert message in capsys.readouterr().err
    folder = write_study([])
    (folder / "tasks" / "a.json").write_text("[]")
    assert cli.main(["report", str(folder)]) == 2
    assert "none of the 1 files" in capsys.readouterr().err
    file = folder / "study.json"
    assert cli.main(["report", str(folder), "--out", str(file)]) == 2
    assert "is a file; give a folder" in capsys.readouterr().err
    assert list(empty.iterdir()) == []


def test_the_command_writes_beside_the_study_and_says_where(
    write_study, capsys, episode_result
):
    folder = write_study([episode_result("gp"), episode_result("kmp")])
    assert cli.main(["report", str(folder), "--reference", "kmp"]) == 0
    assert str(folder / "report.html") in capsys.readouterr().out
    text = (folder / "report.md").read_text()
    assert "`kmp` against each other policy on the same doors and seeds." in text


def test_marks_of_the_text_become_elements_and_nothing_else_does():
    assert inline("**a `b**c`** `b<c` [d](e.rrd) <f> \\[g\\](h)") == (
        "<b>a <code>b**c</code></b> <code>b&lt;c</code> "
        '<a href="e.rrd">d</a> &lt;f&gt; [g](h)'
    )
    # Links lead to the web or to files beside the page.
    assert inline("[a](https://b.c/d?e)") == '<a href="https://b.c/d?e">a</a>'
    for address in ("javascript:x", "data:,x", "//host/x", "JavaScript:x"):
        assert inline(f"[a]({address})") == f"[a]({address})"


def test_both_writers_keep_cells_apart():
    table = Table(columns=("a", "b"), rows=(("group", ""), ("x|y", "1\n2")))
    lead, section = Section(), Section("S", "s")
    lead.say("mind", warning=True)
    lead.items(("one", ""))
    section.table(table, folded="<D>")
    section.table(Table(columns=("c", "d"), rows=(), left=True))
    document = Document("T", lead, [section])
    assert "**\\<D>**\n\n| a | b |" in markdown_page(document)
    assert "| x\\|y | 1<br>2 |" in markdown_page(document)
    page = html_page(document, {})
    assert "<td>x|y</td><td>1<br><small>2</small></td>" in page
    assert '<tr><th colspan="2" scope="rowgroup">group</th></tr>' in page
    assert "<details><summary>&lt;D&gt;</summary>" in page
    assert '<p class="warning">mind</p>' in page
    assert "<ul><li>one</li></ul>" in page
    assert "<table><thead>" in page.replace("\n", "")
    assert '<table class="text">' in page
    Page(page)


def test_the_first_condition_is_named_and_disturbances_have_columns(
    page_of, episode_result
):
    results = []
    for seed in range(6):
        calm = episode_result("gp", seed)
        held = episode_result("gp", seed, disturbance="person")
        held["metrics"] |= {"person_force_peak": 33.0, "release_speed": 0.47}
        results += [calm, held] if seed else [held]
    text = page_of(results)
    lead = text.partition("## ")[0]
    assert (
        "**2 demonstrations per door, teacher noise × 1, randomization none, "
        "disturbance person**; the other 1 below:" in lead
    )
    assert "Plots: 2 demonstrations per door" in text
    rows = cells(text)
    assert rows["gp"]["on a person [N]<br>for 0.5 s [N]"] in (
        "33.0<br>0.0",
        "0.0<br>0.0",
    )
    assert "33.0<br>0.0" in text
    assert "on a stop" not in text


def test_every_number_comes_from_the_results(page):
    rate = success_rate((seed, True) for seed in range(16))
    assert f"| `gp` | 16/16<br>{rate.low:.2f}–{rate.high:.2f} | 16/16" in page
    for said in (
        "`gp`, 16 of 16 (0.81–1.00), is best; next is `kmp`, 8 of 16",
        "`gp`, median 1.0 N, is best; next is `kmp`, behind by 2.0 N",
        # Of all 8 seeds gp opened more doors: 2 · 2⁻⁸, doubled by Holm.
        "| `kmp` | 8 : 0<br>**p 0.016**, n 8 |",
        "| `dmp` | 16 : 0<br>**p 0.016**, n 8 |",
        # Wilcoxon on 8 pairs of one sign: 2 · 2⁻⁸.
        "−2.0<br>**p 0.008**, n 8",
        "| stalled | the hand held on and the door gained no more angle |",
    ):
        assert said in page
    rows = cells(page)
    dmp = rows["dmp"]
    assert [dmp[head].partition("<br>")[0] for head in ("to 60°", "stalled")] == [
        "0/16",
        "16",
    ]
    assert dmp["median angle<br>largest"] == "35.0°<br>38.5°"
    assert [rows[policy]["stalled"] for policy in ("kmp", "gp")] == ["8", "0"]


def test_the_page_says_where_its_numbers_come_from_and_what_they_mean(page):
    for said in (
        "gplfd benchmark --seeds 8",
        "2020-02-02",
        "commit 0123456789ab, gplfd 0.1.0",
        "CPU time per decision [ms]",
        "wall time per decision [ms]",
    ):
        assert said in page
    # What is not the case is not said.
    for other in (
        "not all made by the same code",
        "kinds of machine",
        "control period",
        "on a person",
        "; the other",
    ):
        assert other not in page
    heads = page.partition("**All measures**\n\n")[2].splitlines()[0]
    columns = heads.strip("| ").split(" | ")[1:]
    meanings = page.partition("| column | meaning |")[2]
    assert [one for one in columns if f"| {one} | " not in meanings] == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"git": {"commit": "0123456789abcdef", "dirty": True}},
            [
                "not all made by the same code",
                "1 results: commit 0123456789ab with edits",
            ],
        ),
        (
            {"arithmetic": {"machine": "z80"}},
            ["2 kinds of machine: they are comparable to a tolerance only, see `docs/"],
        ),
        (
            {"metrics": {WALL_TIME: 50.0}},
            ["longer than the control period of 10 ms in 8 of 8 episodes"],
        ),
        (
            {"task": {"policy_source": {"file": "a.py"}}},
            ["`gp` were made by more than one sou"],
        ),
        ({"metrics": {WALL_TIME: None}}, ["| CPU time per decision [ms] | above"]),
    ],
)
def test_what_differs_in_results_is_said(page_of, episode_result, changes, said):
    results = [episode_result("gp", seed) for seed in range(8)]
    for name, value in changes.items():
        for one in results if name == "metrics" else results[:1]:
            one[name] = {**one.get(name, {}), **value}
    text = page_of(results)
    assert [one for one in said if one not in text] == []
