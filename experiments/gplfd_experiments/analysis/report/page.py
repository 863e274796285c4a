"""The report of a study: all sections, and the files they are written to."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from gplfd_experiments.analysis.figures.style import paper_style, write_figure
from gplfd_experiments.analysis.report.document import (
    Block,
    Details,
    Document,
    Paragraph,
    Picture,
    Section,
    code,
    names,
)
from gplfd_experiments.analysis.report.html import html_page
from gplfd_experiments.analysis.report.learning import learning_section
from gplfd_experiments.analysis.report.markdown import FIGURES, markdown_page
from gplfd_experiments.analysis.report.origin import header, origin_section
from gplfd_experiments.analysis.report.outcomes import outcome_details
from gplfd_experiments.analysis.report.paired import paired_tests, standing
from gplfd_experiments.analysis.report.plots import (
    force_by_radius,
    forecast_by_progress,
    success_by_radius,
)
from gplfd_experiments.analysis.report.recorded import recorded_section
from gplfd_experiments.analysis.report.recordings import recording_section
from gplfd_experiments.analysis.report.sentences import PRIVILEGED
from gplfd_experiments.analysis.report.summary import summary_table
from gplfd_experiments.analysis.report.table_one import table_one_section
from gplfd_experiments.analysis.report.trials import trial_sections
from gplfd_experiments.analysis.results.grouping import Runs, conditions, counted
from gplfd_experiments.analysis.results.reading import read_all
from gplfd_experiments.analysis.results.records import StudyResults
from gplfd_experiments.analysis.results.trials_file import FILE as ANSWERS
from gplfd_experiments.analysis.results.trials_file import trial_answers
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.table import Table
from gplfd_policies.arrays.storage import complete_or_absent

HTML, MARKDOWN = "report.html", "report.md"


def write_report(
    study: Path, out: Path | None = None, reference: str = "gp", *others: Path
) -> Path:
    """Write the report of a study's folder.

    Args:
        study: Folder of a `gplfd benchmark` or `gplfd trials`.
        out: Folder for report.html, report.md, figures/ and, of trials, trials.json;
            the study's by default.
        others: Folders whose results are put together with the study's.
        reference: Policy with which the others are compared; where the study has none
            of this name, the best of those that it has.

    Returns:
        The path of the HTML page.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: It is not the folder of a study.
        OSError: A file cannot be written.
    """
    folder = study if out is None else out
    results = read_all([study, *others])
    document = report(results, study, folder, reference)
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


def report(
    results: StudyResults, study: Path, folder: Path, reference: str
) -> Document:
    """Say everything about a study.

    Args:
        results: What the study's folder holds.
        study: That folder, for links to recordings.
        folder: Where the page will be.
        reference: As in `write_report`.
    """
    shown = conditions(one for one in results.episodes if not one.task.trial)
    ran = {title: counted(runs) for title, runs in shown.items()}
    first = next(iter(ran.values()), {})
    policies = sorted({one.policy for one in results.all})
    *warning, counts, command = header(results)
    lead: list[Block] = [*warning]
    if shown:
        lead.append(summary_table(ran))
    if reference not in policies:
        ranking = [*first, *policies]
        best = next((one for one in ranking if one not in PRIVILEGED), ranking[0])
        text = f"{code(reference)} is not in this study; {code(best)} takes its place."
        lead.append(Paragraph(text=text))
        reference = best
    sections = [*trial_sections(results.episodes, study, folder, reference)]
    if first:
        if len(shown) > 1:
            text = f"**{next(iter(shown))}**; the other {len(shown) - 1} below:"
            lead.append(Paragraph(text=text))
        lead += [standing(first, reference), _how_to_read(first)]
        sections += [_opened(shown, first, reference), _paired(ran, reference)]
    lead += [counts, command]
    if results.recorded:
        sections.append(recorded_section(results.recorded, reference))
    if results.tests:
        sections.append(table_one_section(results.tests))
        sections.append(learning_section(results.tests, reference))
    if results.episodes or results.tests:
        sections.append(recording_section(study, folder, policies))
    sections.append(origin_section(results))
    doors = bool(results.episodes or results.tests)
    return Document(
        title=f"{'Opening doors' if doors else 'Recordings'}: the policies compared",
        lead=tuple(lead),
        sections=tuple(sections),
    )


def _opened(shown: Mapping[str, Runs], first: Runs, reference: str) -> Section:
    """All conditions in one table, its details, and plots of the first condition."""
    title, several = next(iter(shown)), len(shown) > 1
    return Section(
        title="Doors opened",
        anchor="doors",
        blocks=(
            *([] if several else [Paragraph(text=f"{title}.")]),
            *([Paragraph(text=f"Plots: {title}.")] if several else []),
            *_plots(first, reference),
            *outcome_details(shown),
        ),
    )


def _paired(ran: Mapping[str, Runs], reference: str) -> Section:
    """Paired tests of every condition; how the reference stands under the others."""
    blocks: list[Block] = []
    for place, (title, runs) in enumerate(ran.items()):
        if len(ran) > 1:
            blocks.append(Paragraph(text=f"**{title[0].upper()}{title[1:]}**"))
        if place:
            blocks.append(standing(runs, reference))
        tests = paired_tests(runs, reference)
        if isinstance(tests, Table):
            tests = Details(title=f"{reference} against each other policy", table=tests)
        blocks.append(tests)
    return Section(title="Paired tests", anchor="tests", blocks=tuple(blocks))


def _how_to_read(runs: Runs) -> Paragraph:
    text = (
        "Policies are compared seed by seed, by their mean difference on the tasks of "
        "a seed that both ran (for forces, times and slip: doors that both opened), "
        "not by their medians: typical difference, its 95 % interval, number of seeds. "
        "Beaten: the interval leaves zero out."
    )
    if privileged := sorted(PRIVILEGED & runs.keys()):
        text += (
            f" {names(privileged)} knows what a robot cannot and is not among the "
            "compared."
        )
    return Paragraph(text=text)


def _plots(runs: Runs, reference: str) -> list[Picture]:
    success = Picture(
        name="success",
        draw=partial(success_by_radius, runs, reference),
        caption="**Doors opened to 60° by the handle's radius,** with Wilson's 95 % "
        "intervals. Blue stripes: radii that were demonstrated. Pale violet: "
        f"{code(reference)}. Policies in order of success, then of radial force; "
        "other doors are left out.",
        alternative="Success rate against radius, a panel per policy",
    )
    force = Picture(
        name="radial_force",
        draw=partial(force_by_radius, runs, reference),
        caption="**Peak radial force on the doors opened to 60°:** a dot per episode, "
        "a line through the medians. It does no work and shows how badly the path fits "
        "the door. Red: the 22.2 N of ADA 404.2.9.",
        alternative="Peak radial force against radius, a panel per policy",
    )
    forecast = Picture(
        name="forecast",
        draw=partial(forecast_by_progress, runs, reference),
        caption="**Error of the forecast of the rest of the path** as the door opens: "
        "median and middle half of all episodes, those included that failed later. A "
        "falling curve is a policy that learns which door it has.",
        alternative="Forecast error against progress, a panel per policy",
    )
    known = any(
        error is not None
        for own in runs.values()
        for one in own
        for error in one.metrics["forecast_error_mm"]
    )
    return [success, force, *([forecast] if known else [])]
