"""Whatever a study's files hold, the report names it and says the rest."""

import copy
import html.parser
import json
import random
import re

import pytest

from gplfd_experiments.analysis.report.page import report, write_report
from gplfd_experiments.analysis.report.recordings import RANKS, recording_name
from gplfd_experiments.analysis.report.writing import html_page, markdown_page
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.cli import main as cli

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_plots")]

ODD = (
    *(None, True, 0, -1, 0.5, 1e308, 10**400, float("nan"), float("inf")),
    *("", "x", "a\nb", "\ud800", "[x](javascript:alert(1))", "````", "z" * 5000),
    *([], [1], ["x", None], {}, {"a": 1}, {"seed": [[]]}),
    json.loads("[" * 100 + "]" * 100),
)
"""Values that no writer of results would write, at least not there."""
TEXTS = ("", "{", "[1]", "{}", "null", "\0", "NaN", "[" * 100_000, '{"a":' * 9_999)
"""Files that hold nothing."""
HOSTILE = (
    "[x](javascript:alert(1))",
    "`[x](javascript:alert(1))`",
    "**[x](//a.b/c)**",
    "<script>alert(1)</script>",
    r"\[x](data:text/html,y)",
    '"><img src=x onerror=y>',
    "$\\frac$|a|b",
    "my_module:make",
    "../../etc/passwd",
    "a" * 200,
)
"""Names that try to become something else."""


@pytest.fixture
def results(episode_result, learning_result):
    """Two policies with an episode and a learning test each, and an error."""
    return [
        *(episode_result(policy, 0) for policy in ("gp", "kmp")),
        *(
            learning_result(policy, outputs_cpu_s={"2": 0.1})
            for policy in ("gp", "kmp")
        ),
        {**episode_result("gp", 1), "error": "ValueError: x"},
    ]


def pages(folder):
    """Both pages, without plots, which take their time."""
    document = report(read_results(folder), folder, folder, "gp")
    images = {picture.name: b"" for picture in document.pictures}
    return html_page(document, images), markdown_page(document)


def paths(value, path=()):
    """Every place in a JSON value."""
    yield path
    if isinstance(value, dict | list):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        for name, part in parts:
            yield from paths(part, (*path, name))


def test_episodes_of_an_older_environment_are_read_until_they_are_run_again(
    write_study, episode_result
):
    old = [episode_result("gp", seed, base="mobile") for seed in range(2)]
    fixed = episode_result("gp", 0)
    folder = write_study([*old, fixed])
    assert len(read_results(folder).episodes) == 3
    again = episode_result("gp", 0, base="mobile", environment_version=1)
    found = read_results(write_study([*old, fixed, again])).episodes
    tasks = [
        (one.task.base, one.task.seed, one.task.environment_version) for one in found
    ]
    assert sorted(tasks) == [("fixed", 0, 0), ("mobile", 0, 1), ("mobile", 1, 0)]
    again["task"]["environment_version"] = "1"
    (reason,) = read_results(write_study([fixed, *old, again])).unreadable
    assert "environment_version" in reason


def mutated(value, rng):
    """The text of a JSON value in which something is odd."""
    if rng.random() < 0.1:
        return rng.choice(TEXTS)
    text = json.dumps(value)
    if rng.random() < 0.15:
        at = rng.randrange(len(text))
        return text[:at] + rng.choice(["", '"', "9", "}", text[at + 9 :]])
    value = copy.deepcopy(value)
    *place, last = rng.choice([path for path in paths(value) if path])
    part = value
    for name in place:
        part = part[name]
    if rng.random() < 0.3:
        del part[last]
    else:
        part[last] = rng.choice(ODD)
    return json.dumps(value)


def test_no_mutated_file_ends_the_report(results, write_study):
    rng = random.Random(0)
    folder = write_study(results)
    (folder / "recordings").mkdir()
    index = folder / "recordings" / "index.json"
    about = {"door": "0.5", "seed": 0, "repeated": False, "different": {"work": [1, 2]}}
    entries = [{"file": f"gp-{rank}.rrd", "rank": rank, **about} for rank in RANKS]
    entries[0] = {**entries[0], "error": "ValueError: x"}
    index.write_text(json.dumps({"order": "", "episodes": entries}))
    files = [*sorted((folder / "tasks").iterdir()), folder / "study.json", index]
    accepted = named = 0
    for _ in range(150):
        file = rng.choice(files)
        whole = file.read_text()
        file.write_text(mutated(json.loads(whole), rng))
        page, text = pages(folder)
        missing = file.name in text
        named += missing
        accepted += not missing
        assert ("javascript" in page) <= ("javascript" in file.read_text())
        assert 'href="javascript' not in page
        file.write_text(whole)
    assert accepted > 20
    assert named > 50


def test_what_is_accepted_can_be_drawn(results, write_study):
    rng = random.Random(1)
    folder = write_study(results)
    for number in range(200):
        text = mutated(rng.choice(results), rng)
        (folder / "tasks" / f"mutated-{number:03}.json").write_text(text)
    assert len(read_results(folder).all) > 30
    write_report(read_results(folder), folder)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda _: "", "it cannot be read as JSON: Expecting value"),
        (lambda text: text[: len(text) // 2], "it cannot be read as JSON: "),
        (lambda _: "{}", "it lacks task"),
        (lambda _: "[1]", "it holds [1], not an object"),
        (lambda _: "[" * 100_000, "it is nested too deeply"),
        (lambda text: text.replace('"work"', '"wrk"'), "it lacks work"),
        (lambda text: text.replace('"work": ', '"work": "a'), "JSON"),
        (lambda text: text.replace("0.055", '"0"'), "governed_share = '0' must be"),
        (lambda text: text.replace("0.055", "NaN"), "infinite or not a number"),
        (lambda text: text.replace("0.055", "1e999"), "infinite or not a number"),
        (lambda text: text.replace("0.055", "1e300"), "no plausible measurement"),
        (lambda text: text.replace("0.055", "9" * 5000), "cannot be read as JSON"),
        (lambda text: text.replace("0.0001", "-1"), "no plausible measurement"),
        (lambda text: text.replace('"none"', '"nne"'), "unknown randomization 'nne'"),
        (lambda text: text.replace('"kind"', '"kid"'), "it lacks kind"),
        (
            lambda text: text.replace('"seed"', '"wind": 1, "seed"'),
            "unknown field 'wind'",
        ),
        (lambda text: f'{{"format_version": 1, {text[1:]}', "it lacks format"),
        (
            lambda text: f'{{"format": "gplfd result", "format_version": 9, {text[1:]}',
            "it has version 9 of gplfd result, and this program reads up to version 1",
        ),
        (lambda text: text.replace('"seed": 0', '"seed": -1'), "seed = -1 must be 0"),
        (lambda text: text.replace('"gp"', '"g\\np"'), "is not a name in one line"),
        (lambda text: text.replace('"radius": 0.5', '"radius": 7'), "radius = 7.0 is"),
    ],
)
def test_a_spoilt_file_is_named_with_the_reason(spoil, reason, results, write_study):
    folder = write_study(results)
    file = folder / "tasks" / "0000.json"
    file.write_text(spoil(file.read_text()))
    found = read_results(folder)
    (said,) = found.unreadable
    assert said.startswith("0000.json: ")
    assert reason in said
    assert len(said) < 250
    assert len(found.all) == len(results) - 1
    (folder / "study.json").write_text("[1]")
    _, text = pages(folder)
    assert said in text
    assert re.search("^study.json: it cannot be read as JSON: ", text, re.M)
    assert "Files without a result, left out: 2." in text


def test_a_file_that_is_being_written_is_no_result(results, write_study, capsys):
    folder = write_study(results)
    whole = (folder / "tasks" / "0000.json").read_text()
    (folder / "tasks" / ".0000.json.x1y2.json").write_text(whole)
    (folder / "tasks" / ".0001.json.x1y2.json").write_text("{")
    found = read_results(folder)
    assert len(found.all) == len(results)
    assert found.unreadable == ()
    for file in (folder / "tasks").glob("[!.]*"):
        file.unlink()
    assert cli.main(["report", str(folder)]) == 2
    assert "it has no tasks/*.json" in capsys.readouterr().err


class Links(html.parser.HTMLParser):
    """Collects the tags of a page, what they refer to, and their ids."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.targets, self.ids = set(), [], []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        for name, value in attributes:
            assert not name.startswith("on")
            if name in ("href", "src"):
                self.targets.append(value)
            if name == "id":
                self.ids.append(value)


@pytest.mark.parametrize("name", HOSTILE)
def test_no_name_becomes_anything_else(name, results, write_study):
    for result in results:
        result["versions"] = {name: name}
        result["git"]["commit"] = name
        if result["task"]["policy"] == "kmp":
            result["task"] |= {"policy": name, "policy_source": {"file": name}}
        if "door" in result["task"]:
            result["task"]["door"] = name
            result["metrics"]["failure"] = name
    results[1]["metrics"]["success"] = False
    results[-1]["error"] = f"{name}\n````\n{name}"
    said = {"platform": {name: name}, "config": {name: [name]}, "created": name}
    folder = write_study(results, command=[name], **said)
    page, text = pages(folder)
    found = Links(page)
    assert "script" not in found.tags
    allowed = re.compile(r"#[a-z0-9-]+|data:image/svg\+xml;base64,|recordings/[\w.%-]+")
    assert all(allowed.fullmatch(target) for target in found.targets), found.targets
    assert len(set(found.ids)) == len(found.ids)
    # Outside code, nothing of Markdown's is left that was not escaped.
    outside = re.sub(r"(?ms)^(`{3,})text\n.*?\n\1$", "", text)
    outside = re.sub(r"\\.|`[^`\n]*`", "", outside)
    assert "](" not in re.sub(r"!\[[\w ,]+\]\(figures/\w+\.png\)", "", outside)
    assert "<" not in outside.replace("<br>", "")
    assert len(re.findall("^(`{3,})text$", text, re.M)[-1]) > 4


def test_any_name_can_be_drawn(write_study, episode_result, learning_result):
    made = [
        make(name) for name in HOSTILE for make in (episode_result, learning_result)
    ]
    folder = write_study(made)
    write_report(read_results(folder), folder, reference=HOSTILE[0])


def test_a_user_s_policy_is_everywhere(
    results, write_study, episode_result, learning_result
):
    mine = "my_module:make"
    source = {"kind": "module", "file": "my_module.py", "sha256": "ab12"}
    results += [episode_result(mine, seed, opened=False) for seed in range(2)]
    results.append(learning_result(mine, outputs_cpu_s={"2": 0.1}))
    for result in results[-3:]:
        result["task"]["policy_source"] = source
    folder = write_study(results)
    (folder / "recordings").mkdir()
    file = recording_name(mine, "best")
    (folder / "recordings" / file).write_bytes(b"")
    write_report(read_results(folder), folder)
    text = (folder / "report.md").read_text()
    assert "- `my_module:make`: `kind module, file my_module.py, sha256 ab12`" in text
    tables = re.findall(r"(?m)^\| [\s\S]*?\n\n", text)
    of_policies = [table for table in tables if not table.startswith("| column |")]
    lacking = [table for table in of_policies if f"`{mine}`" not in table]
    assert lacking == []
    assert f"(recordings/{file})" in text.replace("\\_", "_")
    first, second = read_results(folder).episodes[0], read_results(folder).episodes[-1]
    assert (first.policy, second.policy) == ("gp", mine)
    assert first.pair == second.pair or first.task.seed != second.task.seed


def test_recordings_have_safe_names_of_their_own():
    names = {recording_name(policy, "best") for policy in (*HOSTILE, "my_module/make")}
    assert len(names) == len(HOSTILE) + 1
    assert all(re.fullmatch(r"[\w-]{1,80}-best\.rrd", name, re.A) for name in names)
    assert recording_name("gp-paper", "worst") == "gp-paper-worst.rrd"
