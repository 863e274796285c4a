"""The report of constructed studies: what it says, and that it needs nothing else."""

import base64
import html.parser
import json
import math
import re

import pytest

from experiments import cli
from experiments.figures import style
from experiments.learning_tests.criteria import CRITERIA
from experiments.report.document import Document, Items, Paragraph, Section, Table
from experiments.report.html import html_page, inline
from experiments.report.markdown import markdown_page
from experiments.report.page import report, write_report
from experiments.results.records import read_results
from experiments.results.table import wilson_interval
from experiments.teacher import standard_teacher
from gplfd_env.config import DoorConfig

VOID = {"meta", "img", "br", "link", "hr"}


def episode(policy, seed=0, radius=0.5, *, radial=1.0, opened=True, **task):
    config = {name: getattr(DoorConfig(), name) for name in DoorConfig.__slots__}
    return {
        "task": {
            "kind": "episode",
            "policy": policy,
            "door": f"{radius:g}",
            "door_config": config | {"radius": radius},
            "seed": seed,
            "demonstrations_per_door": 2,
            "teacher": standard_teacher(),
            "randomization": "none",
            **task,
        },
        "versions": {"gplfd": "0.1.0"},
        "git": {"commit": "0123456789abcdef", "dirty": False},
        "metrics": {
            "radius": radius,
            "success": opened,
            "failure": "" if opened else "stalled",
            "final_angle_deg": 64.0 if opened else 31.5 + seed,
            "time_to_15_deg": 2.0,
            "time_to_30_deg": 3.0,
            "time_to_60_deg": 5.0 + 0.01 * seed if opened else None,
            "force_tangential_peak": 2.0,
            "force_radial_peak": radial + 0.01 * seed,
            "slip_max_mm": 1.0,
            "work": 0.4,
            "prediction_error_position": 1e-4,
            "latency_median_ms": 0.2,
            "forecast_progress": [0.25, 0.75],
            "forecast_error_mm": [20.0, None],
        },
    }


def skill(policy, seed=0, **metrics):
    return {
        "task": {
            "kind": "skill",
            "policy": policy,
            "seed": seed,
            "demonstrations_per_door": 2,
            "teacher": standard_teacher(),
            "held_out": "demonstration",
        },
        "versions": {"gplfd": "0.1.0"},
        "git": {"commit": "0123456789abcdef", "dirty": False},
        "metrics": {
            "rmse_position_m": 0.02,
            "rmse_rotation_rad": 0.03,
            "nlpd": -2.0,
            "coverage_50": 0.5,
            "coverage_90": 0.85,
            "coverage_95": 0.9,
            "spread_followed": 0.9,
            "prior_mean_used": None,
            **metrics,
        },
    }


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Writes results into a folder; plots are small."""
    monkeypatch.setitem(style._STYLE, "savefig.dpi", 30)

    def write(results, **said):
        folder = tmp_path / "study"
        (folder / "tasks").mkdir(parents=True, exist_ok=True)
        for number, result in enumerate(results):
            path = folder / "tasks" / f"{number:04}.json"
            path.write_text(json.dumps(result))
        command = ["gplfd", "benchmark", "--seeds", "8"]
        header = {"command": command, "created": "2020-02-02", **said}
        (folder / "study.json").write_text(json.dumps(header))
        return folder

    return write


def policies(seeds=8):
    """gp opens all, kmp opens the demonstrated radius only, dmp none."""
    return [
        result
        for seed in range(seeds)
        for radius in (0.5, 0.42)
        for result in (
            episode("gp", seed, radius),
            episode("kmp", seed, radius, radial=3.0, opened=radius == 0.5),
            episode("dmp", seed, radius, opened=False),
        )
    ]


def markdown(folder):
    """The text alone: plots take their time."""
    return markdown_page(report(read_results(folder), folder, folder))


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


def test_the_page_parses_and_refers_to_nothing_outside(study):
    folder = study([*policies(), skill("gp"), skill("kmp")])
    text = write_report(folder).read_text()
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


def test_equal_results_give_equal_bytes(study, tmp_path):
    folder = study([*policies(), skill("gp")])
    for out in ("first", "second"):
        write_report(folder, tmp_path / out)
    files = sorted(p for p in (tmp_path / "first").rglob("*") if p.is_file())
    assert len(files) == 12
    for file in files:
        other = tmp_path / "second" / file.relative_to(tmp_path / "first")
        assert file.read_bytes() == other.read_bytes(), file.name


def test_every_number_comes_from_the_results(study):
    text = markdown(study(policies()))
    low, high = wilson_interval(16, 16)
    assert f"| `gp` | 16/16<br>{low:.2f}–{high:.2f} | 8/8" in text
    assert "`gp` is best: 16 of 16" in text
    assert "`gp` is best, median 1.0 N; the nearest, `kmp`, is behind by 2.0 N" in text
    # McNemar: 8 doors only gp opened, 2 · 2⁻⁸, and 16, 2 · 2⁻¹⁶, doubled by Holm.
    assert "| `kmp` | 8 : 0<br>**p 0.008**, n 16 |" in text
    assert "| `dmp` | 16 : 0<br>**p \\< 0.001**, n 16 |" in text
    # Wilcoxon on 8 pairs of one sign: 2 · 2⁻⁸.
    assert "−2.0<br>**p 0.008**, n 8" in text


def test_tests_of_a_column_are_corrected_together(study):
    others = [episode("promp", seed, opened=False) for seed in range(8)]
    others += [episode("kmp", seed, opened=False) for seed in range(8)]
    text = markdown(study([*(episode("gp", seed) for seed in range(8)), *others]))
    # 2 · 2⁻⁸ for each, times two.
    assert "| `kmp` | 8 : 0<br>**p 0.016**, n 8 |" in text
    assert "| `promp` | 8 : 0<br>**p 0.016**, n 8 |" in text


def test_the_command_and_the_code_are_named(study):
    text = markdown(study(policies()))
    assert "gplfd benchmark --seeds 8" in text
    assert "2020-02-02" in text
    assert "commit 0123456789ab, gplfd 0.1.0" in text
    assert "not all made by the same code" not in text


def test_results_of_other_code_are_told(study):
    results = policies()
    results[0]["git"]["dirty"] = True
    text = markdown(study(results))
    assert "not all made by the same code" in text
    assert "1 results: commit 0123456789ab with edits" in text


def test_a_policy_that_opened_no_door_and_why(study):
    text = markdown(study(policies()))
    assert (
        "**`dmp`** opened none of 16 doors: 16 × stalled (the hand held on and the "
        "door gained no more angle). Its widest opening was 38.5°." in text
    )
    assert "| `kmp` | 8 |" in text


def test_a_door_that_slipped_away_is_opened_but_not_solved(study):
    slipped = episode("gp", 50, 0.5)
    slipped["metrics"] |= {"success": False, "failure": "grasp_lost"}
    text = markdown(study([*policies(), slipped]))
    assert "**Doors opened to 60°:** `gp` is best: 17 of 17" in text
    assert "**Opened and held, the handle in the hand:** `gp` is best: 16 of 17" in text
    solved, opened = re.findall(r"^\| `gp` \| (\d+/\d+)<br>", text, re.M)[:2]
    assert (solved, opened) == ("16/17", "17/17")
    assert "| `gp` | 1 | 0 | 64.0° |" in text


def test_errors_count_as_closed_doors_and_are_listed(study):
    broken = episode("gp", 99, 0.5)
    del broken["metrics"]
    broken["error"] = "ValueError: too <few> demonstrations"
    folder = study([*policies(), broken])
    write_report(folder)
    text = (folder / "report.md").read_text()
    assert "16/17" in text
    assert "1 × gp, 0.5: ValueError: too <few> demonstrations" in text
    assert "**1 ended in an error**" in text
    assert "too &lt;few&gt; demonstrations" in (folder / "report.html").read_text()


@pytest.mark.parametrize(
    ("results", "said"),
    [
        ([episode("gp")], "nothing to compare"),
        ([episode("dmp", opened=False)], "`gp` is not in this study"),
        ([skill("gp")], "1 learning tests of 1 policies"),
        (
            [{**episode("gp"), "error": "RuntimeError: gone"}],
            "opened none of 1 doors: 1 × error (the policy could not learn or act). "
            "First error: `RuntimeError: gone`",
        ),
        ([{**skill("kmp"), "error": "RuntimeError: gone"}], "no learning test with a"),
    ],
)
def test_parts_of_a_study_give_a_report(study, results, said):
    text = markdown(study(results))
    assert said in text
    assert "Traceback" not in text


def test_results_of_an_older_study_are_read(study):
    old = episode("gp")
    for name in ("kind", "randomization", "demonstrations_per_door", "teacher"):
        del old["task"][name]
    old["metrics"] = {"time_to_60_deg": 5.0}
    text = markdown(study([old, episode("gp", 1)]))
    assert "2/2" in text


def test_an_older_result_pairs_with_a_newer_one(study):
    old = episode("kmp")
    for name in ("kind", "randomization"):
        del old["task"][name]
    first, second = read_results(study([old, episode("gp")])).episodes
    assert first.pair == second.pair


def test_radii_that_are_drawn_are_told_in_bands(study):
    drawn = [episode("gp", seed, 0.5, randomization="hard") for seed in range(3)]
    for result, radius in zip(drawn, (0.33, 0.36, 0.58), strict=True):
        result["metrics"]["radius"] = radius
    text = markdown(study([*policies(), *drawn]))
    assert "## Doors opened: hard randomization" in text
    assert "| all doors | undemonstrated radii | 0.3–0.4 m | 0.5–0.6 m |" in text


def test_doors_with_other_hinges_are_not_taken_for_demonstrated(study):
    heavy = episode("gp", 0, 0.5, door="heavy")
    heavy["task"]["door_config"]["closer_preload"] = 5.0
    text = markdown(study([*policies(), heavy]))
    head = "| policy | all doors | demonstrated radii | undemonstrated radii | other hi"
    assert head in text
    assert (
        "| `gp` | 17/17<br>0.82–1.00 | 8/8<br>0.68–1.00 | 8/8<br>0.68–1.00 | 1/1"
        in (text)
    )


def judged(row, *, earned):
    """Metrics that just do or do not earn a mark."""
    metrics = {}
    for limit in CRITERIA[row].limits:
        high = limit.high < math.inf
        bound = limit.high if high else limit.low
        metrics[limit.metric] = bound * (0.5 if high == earned else 2.0)
    return metrics


def test_table_1_has_a_number_and_tells_where_the_paper_says_otherwise(study):
    via, growth = "Via-point Adaptation", "Prediction Uncertainty"
    good = {**judged(via, earned=True), **judged(growth, earned=True)}
    bad = {**judged(via, earned=False), **judged(growth, earned=False)}
    text = markdown(study([skill("gp", **good), skill("promp", **bad)]))
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


def test_recordings_are_linked_from_where_the_page_is(study, tmp_path):
    folder = study([episode("gp")])
    recordings = folder / "recordings"
    recordings.mkdir()
    for name in ("gp-best.rrd", "comparison.rrd"):
        (recordings / name).write_bytes(b"")
    entry = {"file": "gp-best.rrd", "door": "0.5", "seed": 0, "repeated": False}
    entry["different"] = {"slip_max_mm": [1.0, 2.0]}
    (recordings / "index.json").write_text(json.dumps({"episodes": [entry]}))
    out = tmp_path / "elsewhere"
    write_report(folder, out)
    text = (out / "report.md").read_text()
    assert "[comparison.rrd](../study/recordings/comparison.rrd)" in text
    assert (
        "[gp-best.rrd](../study/recordings/gp-best.rrd) 0.5, seed 0 (**differs" in text
    )
    assert "stored result:** slip max mm)" in text
    for link in re.findall(r"\((\S+\.rrd)\)", text):
        assert (out / link).resolve().is_file()


def test_files_that_hold_no_result_are_named(study):
    folder = study(policies())
    (folder / "tasks" / "broken.json").write_text("{")
    (folder / "tasks" / "empty.json").write_text('{"task": {"policy": "gp"}}')
    text = markdown(folder)
    assert "2 files hold no result" in text
    assert "broken.json: JSONDecodeError" in text
    assert "empty.json: ValueError: neither metrics nor an error" in text


def test_wrong_folders_end_with_status_2(study, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    for folder, message in (
        (tmp_path / "absent", "there is no folder"),
        (empty, "is not the folder of a study: it has no tasks/*.json"),
    ):
        assert cli.main(["report", str(folder)]) == 2
        assert message in capsys.readouterr().err
    folder = study([])
    (folder / "tasks" / "a.json").write_text("[]")
    assert cli.main(["report", str(folder)]) == 2
    assert "none of the 1 files" in capsys.readouterr().err
    file = folder / "study.json"
    assert cli.main(["report", str(folder), "--out", str(file)]) == 2
    assert "is a file; give a folder" in capsys.readouterr().err
    assert list(empty.iterdir()) == []


def test_the_command_writes_beside_the_study_and_says_where(study, capsys):
    folder = study([episode("gp")])
    assert cli.main(["report", str(folder)]) == 0
    assert str(folder / "report.html") in capsys.readouterr().out
    assert (folder / "report.md").is_file()


def test_missing_numbers_are_none_not_zero(study):
    folder = study([episode("gp")])
    (only,) = read_results(folder).episodes
    assert only.number("force_radial_peak") == 1.0
    assert only.number("no_such_metric") is None
    assert only.numbers("forecast_error_mm") == [20.0, None]
    assert only.numbers("no_such_metric") == []


def test_marks_of_the_text_become_elements_and_nothing_else_does():
    assert inline("**a** `b<c` [d](e.rrd) <f>") == (
        '<b>a</b> <code>b&lt;c</code> <a href="e.rrd">d</a> &lt;f&gt;'
    )


def test_both_writers_keep_cells_apart():
    document = Document(
        title="T",
        lead=(Paragraph(text="mind", warning=True), Items(texts=("one",))),
        sections=(
            Section(
                title="S",
                anchor="s",
                blocks=(Table(columns=("a", "b"), rows=(("x|y", "1\n2"),)),),
            ),
        ),
    )
    assert "| x\\|y | 1<br>2 |" in markdown_page(document)
    page = html_page(document, {})
    assert "<td>x|y</td><td>1<br><small>2</small></td>" in page
    assert '<p class="warning">mind</p>' in page
    Page(page)
