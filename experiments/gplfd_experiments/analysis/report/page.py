"""The report of a study: `report` returns its page, `write_report` writes it."""

import shlex
from collections import Counter
from pathlib import Path
from typing import Final

from gplfd_experiments.analysis.figures.style import paper_style, write_figure
from gplfd_experiments.analysis.report import document, sections
from gplfd_experiments.analysis.report.document import Block, Plot, Section, Text, code
from gplfd_experiments.analysis.results import measures, trials
from gplfd_experiments.analysis.results.reading import StudyResults
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.store import PLANNED
from gplfd_policies.arrays.storage import complete_or_absent

HTML, MARKDOWN = "report.html", "report.md"
_ORIGIN: Final = "What was run"
_LEFT_OUT: Final = "Files without a result, left out"
_RECORDED: Final = (
    "Each recording is left out in turn and predicted from the others. The phase is "
    "the share of the path that the hand has covered; **online**, the method estimates "
    "it from the samples so far, as on a robot."
)


def write_report(
    results: StudyResults, study: Path, out: Path | None = None, reference: str = "gp"
) -> Path:
    """Write report.html, whose path is returned, report.md, figures/ and trials.json.

    They are written to ``out``, by default the study's folder. Policies are compared
    with the reference, or with the best policy if the study lacks the reference.
    """
    folder = study if out is None else out
    page, plots = report(results, reference), folder / document.FIGURES
    images: dict[str, bytes] = {}
    for plot in (block for section in page for block in section.blocks):
        if isinstance(plot, Plot):
            with paper_style():
                write_figure(plot.draw(), plots, plot.name)
            images[plot.name] = (plots / f"{plot.name}.svg").read_bytes()
    html = document.html_page(page, images)
    for name, text in {MARKDOWN: document.markdown_page(page), HTML: html}.items():
        with complete_or_absent(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    if trials.of_trials(results):
        write_json(folder / trials.FILE, trials.trial_answers(results), indent=None)
    return folder / HTML


def report(results: StudyResults, reference: str) -> list[Section]:
    """Return the sections of the report of a study."""
    if document.kind_of(reference) == document.TOLD:
        raise ValueError(
            f"--reference {reference} knows the door, as no robot does, so others "
            "cannot be judged by it; give another policy of the study"
        )
    episodes = [episode for episode in results.episodes if not episode.task.trial]
    groups = measures.by_condition(episodes).items()
    conditions = {str(which): measures.ranked(group) for which, group in groups}
    lead, questions = _warnings(results), list[Section]()
    of_trials = len(episodes) < len(results.episodes)
    if conditions:
        lead.append(sections.summary_table(conditions))
    policies = sorted({result.policy for result in results.all})
    if reference not in ("gp", *policies):
        raise ValueError(f"--reference {reference} is none of {', '.join(policies)}")
    if reference not in policies:
        ranking = [*next(iter(conditions.values()), {}), *policies]
        untold = (p for p in ranking if document.kind_of(p) != document.TOLD)
        best = next(untold, reference)
        text = f"{code(reference)} is not in this study"
        place = f"; {code(best)} takes its place." if best != reference else "."
        lead.append(Text(text + place))
        reference = best

    # The number of results, and the command that made them.
    parts = (
        (results.episodes, "episodes"),
        (results.tests, "learning tests"),
        (results.recorded, "recordings left out"),
    )
    done = " and ".join(f"{len(some)} {what}" for some, what in parts if some)
    created, command = results.study.get("created"), results.study.get("command")
    text = f"{done} of {len(policies)} policies"
    if isinstance(created, str):
        text += f", started {document.literal(created)}"
    text += ". Every number on this page is computed from the result files of"
    made = "(study.json with the command is missing)"
    if isinstance(command, list) and command:
        made = shlex.join(map(str, command))
    lead += [Text(text), Text(made, "verbatim")]

    if of_trials:
        questions += sections.trial_sections(results, reference)
    if conditions:
        questions.append(sections.doors_section(conditions, reference))
        tests = [
            sections.paired_tests(title, runs, reference)
            for title, runs in conditions.items()
        ]
        questions.append(Section("Paired tests", tests))
    if results.recorded:
        title = "What was learned from the recordings"
        blocks = Text(_RECORDED), sections.overview(results.recorded)
        questions.append(sections.learning_section(results.recorded, title, *blocks))
    if results.tests:
        questions.append(sections.table_one_section(results.tests))
        title = "What was learned, without a robot"
        questions.append(sections.learning_section(results.tests, title))
    questions.append(Section(_ORIGIN, _origin(results)))
    robot = bool(results.episodes or results.tests)
    title = f"{'Opening doors' if robot else 'Recordings'}: the policies compared"
    return [Section(title, lead), *questions]


def unfinished(results: StudyResults) -> str:
    """Return the number of planned tasks without a result; empty if there is none."""
    planned = results.study.get(PLANNED)
    if not isinstance(planned, int) or len(results.all) >= planned:
        return ""
    missing = planned - len(results.all)
    return f"{missing} of {planned} tasks have no result: run the study again"


def _warnings(results: StudyResults) -> list[Block]:
    """Return a paragraph with important warnings, if there are any."""
    warnings = [document.literal(text) for text in measures.remarks(results.episodes)]
    if failed := sum(bool(result.error) for result in results.tests):
        tests = f"{failed} of {len(results.tests)} learning tests ended in an error."
        warnings.append(tests)
    if len({result.code for result in results.all}) > 1:
        warnings.append(
            "These results were not all made by the same code; differences between "
            "policies may be differences between versions. Use another --out, or "
            "delete the folder, to have one version."
        )
    # A file that was edited between two parts of a study.
    pairs = {(result.policy, result.policy_source) for result in results.all}
    sources = Counter(policy for policy, _ in pairs)
    if mixed := sorted(policy for policy, n in sources.items() if n > 1):
        names = ", ".join(map(code, mixed))
        text = f"Results of {names} come from more than one source file or version."
        warnings.append(text)
    # Tasks that only some policies ran.
    every = {result.pair for result in results.episodes}
    gaps = [
        f"{code(policy)} {number}"
        for policy, episodes in measures.grouped(results.episodes, "policy").items()
        if (number := len(every - {result.pair for result in episodes}))
    ]
    if gaps:
        warnings.append(
            f"Of the {len(every)} episodes that any policy ran, some policies lack: "
            f"{', '.join(gaps)}. Rates count what was run; tests compare what both ran."
        )
    if missing := unfinished(results):
        warnings.append(f"{missing}.")
    if results.unreadable:
        warnings.append(f"{_LEFT_OUT}: {len(results.unreadable)}.")
    text = f"{' '.join(warnings)} See “{_ORIGIN}”."
    return [Text(text, "warning")] if warnings else []


def _origin(results: StudyResults) -> list[Block]:
    """Return provenance, errors and what could not be read."""
    codes = Counter(result.code for result in results.all).most_common()
    lines = "\n".join(f"{number} results: {name}" for name, number in codes)
    blocks: list[Block] = [Text("The results were made by"), Text(lines, "verbatim")]
    machines = len({result.machine for result in results.all})
    if machines > 1:
        text = (
            f"These results were made on {machines} kinds of machine: they are equal "
            "only up to a tolerance, see `docs/reference.md`."
        )
        blocks.append(Text(text))
    named: dict[str, list[tuple[str, object]]] = {}
    for title, entry in (
        ("Machine", "platform"),
        ("Settings of the last command", "config"),
    ):
        values = results.study.get(entry)
        named[title] = [*values.items()] if isinstance(values, dict) else []
    foreign = ((r.policy, r.policy_source) for r in results.all if r.policy_source)
    named["Policies that are not this project's"] = [*dict.fromkeys(foreign)]
    for title, pairs in named.items():
        if rows := tuple((code(name), code(value)) for name, value in pairs):
            columns = ("name", "value")
            blocks.append(Table(columns=columns, rows=rows, left=True, title=title))
    failed = [result for result in results.all if result.error]
    reasons = measures.grouped(failed, "error").items()
    errors = []
    for reason, group in sorted(reasons, key=lambda item: (-len(item[1]), item[0])):
        doors_of = (getattr(result.task, "door", "learning test") for result in group)
        names = (f"{r.policy}, {door}" for r, door in zip(group, doors_of, strict=True))
        errors.append(f"{len(group)} × {'; '.join(dict.fromkeys(names))}: {reason}")
    for text, details in (
        ("Tasks that ended in an error:", errors),
        (f"{_LEFT_OUT}:", results.unreadable),
    ):
        if details:
            blocks += [Text(text, "warning"), Text("\n".join(details), "verbatim")]
    return blocks
