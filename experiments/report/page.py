"""The report of a study: all sections, and the files they are written to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from experiments.report.document import Block, Document, Paragraph, Picture, Section
from experiments.report.doors import (
    HOW_TO_READ,
    paired_tests,
    quality_tables,
    rate_tables,
    verdicts,
)
from experiments.report.html import html_page
from experiments.report.learning import learning_section
from experiments.report.markdown import FIGURES, markdown_page
from experiments.report.origin import header, origin_section
from experiments.report.plots import (
    force_by_radius,
    forecast_by_progress,
    success_by_radius,
)
from experiments.report.recordings import recording_section
from experiments.report.shortfalls import shortfall_section
from experiments.report.table_one import table_one_section
from experiments.results.grouping import by_condition, difference, ranked
from experiments.results.records import Episode, StudyResults, read_results
from experiments.study.settings import Condition
from policies.storage import complete_or_absent

HTML, MARKDOWN = "report.html", "report.md"


def write_report(study: Path, out: Path | None = None) -> Path:
    """Write the report of a study's folder.

    Args:
        study: Folder of a `gplfd benchmark`.
        out: Folder for report.html, report.md and figures/; the study's by default.

    Returns:
        The path of the HTML page.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: It is not the folder of a study.
        OSError: A file cannot be written.
    """
    from experiments.figures.style import paper_style, write_figure

    results = read_results(study)
    folder = study if out is None else out
    document = report(results, study, folder)
    images: dict[str, bytes] = {}
    for picture in document.pictures:
        with paper_style():
            write_figure(picture.draw(), folder / FIGURES, picture.name)
        images[picture.name] = (folder / FIGURES / f"{picture.name}.svg").read_bytes()
    _write(folder / MARKDOWN, markdown_page(document))
    _write(folder / HTML, html_page(document, images))
    return folder / HTML


def _write(path: Path, text: str) -> None:
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def report(results: StudyResults, study: Path, folder: Path) -> Document:
    """Tell a study.

    Args:
        results: What the study's folder holds.
        study: That folder, for links to recordings.
        folder: Where the page will be.
    """
    policies = sorted({one.policy for one in results.outcomes})
    sections = [table_one_section(results.tests)]
    conditions = by_condition(results.episodes)
    for place, (condition, episodes) in enumerate(conditions.items()):
        told = difference(condition, next(iter(conditions)))
        sections.extend(_door_sections(condition, episodes, place, told))
    sections.append(learning_section(results.tests))
    if results.episodes:
        sections.append(shortfall_section(results.episodes))
    sections.append(recording_section(study, folder, policies))
    sections.append(origin_section(results))
    lead: tuple[Block, ...] = header(results)
    if conditions:
        standard = next(iter(conditions.values()))
        lead = (*lead, verdicts(standard), Paragraph(text=HOW_TO_READ))
    return Document(
        title="Opening doors: the policies compared",
        lead=lead,
        sections=tuple(sections),
    )


def _door_sections(
    condition: Condition, episodes: Sequence[Episode], place: int, told: str
) -> list[Section]:
    """Rates, quality and tests under one condition; plots of the first only."""
    suffix, after = (f"-{place + 1}", f": {told}") if place else ("", "")
    text = f"{str(condition)[0].upper()}{str(condition)[1:]}."
    rates: list[Block] = [Paragraph(text=text), *rate_tables(episodes)]
    quality = quality_tables(episodes)
    if place:
        rates.insert(1, verdicts(episodes))
    else:
        rates.insert(1, _rate_plot(episodes))
        quality = [_force_plot(episodes), *quality, *_forecast_plots(episodes)]
    parts = {
        ("opened", "Doors opened"): rates,
        ("quality", "Forces, times and forecasts"): quality,
        ("tests", "Paired tests"): paired_tests(episodes),
    }
    return [
        Section(title=f"{title}{after}", anchor=f"{name}{suffix}", blocks=tuple(blocks))
        for (name, title), blocks in parts.items()
    ]


def _rate_plot(episodes: Sequence[Episode]) -> Picture:
    runs = ranked(episodes)
    return Picture(
        name="success",
        draw=lambda: success_by_radius(runs),
        caption="**Doors opened to 60° by the handle's radius,** with Wilson's 95 % "
        "intervals. Blue stripes: radii that were demonstrated. Pale violet: `gp`. "
        "Policies in order of success, then of radial force; doors with other hinges "
        "are left out.",
        alternative="Success rate against radius, a panel per policy",
    )


def _force_plot(episodes: Sequence[Episode]) -> Picture:
    runs = ranked(episodes)
    return Picture(
        name="radial_force",
        draw=lambda: force_by_radius(runs),
        caption="**Peak radial force on the doors opened to 60°:** a dot per episode, "
        "a line through the medians. It does no work and tells how badly the path fits "
        "the door. Red: the 22.2 N of ADA 404.2.9.",
        alternative="Peak radial force against radius, a panel per policy",
    )


def _forecast_plots(episodes: Sequence[Episode]) -> list[Block]:
    runs = ranked(episodes)
    told = any(
        error is not None
        for one in episodes
        for error in one.numbers("forecast_error_mm")
    )
    if not told:
        return []

    return [
        Picture(
            name="forecast",
            draw=lambda: forecast_by_progress(runs),
            caption="**Error of the forecast of the rest of the path** as the door "
            "opens: median and middle half of all episodes, those included that failed "
            "later. A falling curve is a policy that learns which door it has.",
            alternative="Forecast error against progress, a panel per policy",
        )
    ]
