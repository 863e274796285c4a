"""The report of a study: `report` returns a document, `write_report` writes it."""

from pathlib import Path
from typing import Final

from gplfd_experiments.analysis.figures.style import paper_style, write_figure
from gplfd_experiments.analysis.report import (
    doors,
    origin,
    predictions,
    trials,
)
from gplfd_experiments.analysis.report.document import (
    FIGURES,
    Document,
    Section,
    code,
    html_page,
    markdown_page,
)
from gplfd_experiments.analysis.results.measures import (
    PRIVILEGED,
    by_condition,
    counted,
    ranked,
)
from gplfd_experiments.analysis.results.reading import StudyResults
from gplfd_experiments.analysis.results.trials import FILE as ANSWERS
from gplfd_experiments.analysis.results.trials import trial_answers
from gplfd_experiments.files.plain_data import write_json
from gplfd_policies.arrays.storage import complete_or_absent

HTML: Final = "report.html"
MARKDOWN: Final = "report.md"


def write_report(
    results: StudyResults, study: Path, out: Path | None = None, reference: str = "gp"
) -> Path:
    """Write report.html, report.md, figures/ and, for trials, trials.json.

    They are written to ``out``, by default the study's folder. Policies are compared
    with the reference, or with the best policy if the study lacks the reference.
    Returns the path of the HTML page.
    """
    folder = study if out is None else out
    document = report(results, reference)
    images: dict[str, bytes] = {}
    for picture in document.pictures:
        with paper_style():
            write_figure(picture.draw(), folder / FIGURES, picture.name)
        images[picture.name] = (folder / FIGURES / f"{picture.name}.svg").read_bytes()
    for name, text in (
        (MARKDOWN, markdown_page(document)),
        (HTML, html_page(document, images)),
    ):
        with complete_or_absent(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    answers = trial_answers(results)
    if answers["trials"]:
        write_json(folder / ANSWERS, answers, indent=None)
    return folder / HTML


def report(results: StudyResults, reference: str) -> Document:
    """Return the report of a study."""
    episodes = [one for one in results.episodes if not one.task.trial]
    shown = {str(title): ranked(own) for title, own in by_condition(episodes).items()}
    ran = {title: counted(runs) for title, runs in shown.items()}
    first = next(iter(ran.values()), {})
    policies = sorted({one.policy for one in results.all})

    lead = Section()
    origin.say_warnings(lead, results)
    trials.add_tiers(lead, results)
    if shown:
        lead.table(doors.summary_table(ran))
    if reference not in policies:
        ranking = [*first, *policies]
        best = next((one for one in ranking if one not in PRIVILEGED), ranking[0])
        lead.say(
            f"{code(reference)} is not in this study; {code(best)} takes its place."
        )
        reference = best
    origin.say_command(lead, results)

    sections = trials.trial_sections(results, reference)
    if first:
        sections += [
            doors.doors_section(shown, reference),
            doors.tests_section(ran, reference),
        ]
    if results.recorded:
        sections.append(predictions.recorded_section(results.recorded, reference))
    if results.tests:
        sections.append(predictions.table_one_section(results.tests))
        sections.append(predictions.learning_section(results.tests, reference))
    robot = bool(results.episodes or results.tests)
    sections.append(origin.origin_section(results))
    title = f"{'Opening doors' if robot else 'Recordings'}: the policies compared"
    return Document(title, lead, sections)
