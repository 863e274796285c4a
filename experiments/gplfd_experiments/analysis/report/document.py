"""The content of a report, written as one HTML file and as Markdown beside its plots.

Texts may contain ``**bold**``, ```code```, ``[links](address)`` and backslashes before
characters that are not marks. All other characters are shown unchanged. Texts from
files go through `code` or `literal`.
"""

import base64
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from gplfd_experiments.analysis.results.measures import Measure, counted
from gplfd_experiments.files.table import Table, markdown_table


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; an important one is marked as a warning."""

    text: str
    warning: bool


@dataclass(frozen=True, slots=True)
class Items:
    """A list of short texts."""

    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Verbatim:
    """Lines without marks: commands, error messages."""

    text: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A plot, drawn with `figures.style.paper_style` when the page is written."""

    name: str
    """Name of its files, without suffix."""
    draw: Callable[[], Figure]
    caption: str
    alternative: str
    """Alternative text of the plot."""


@dataclass(frozen=True, slots=True)
class Details:
    """A table that HTML shows collapsed under a title without marks."""

    title: str
    table: Table


Block = Paragraph | Items | Verbatim | Table | Picture | Details
Cell = Callable[[Sequence[Any]], str]
"""Returns the text of a table cell from the results of a policy that count."""


@dataclass(slots=True)
class Section:
    """Blocks under a heading; the introduction of a page has no heading."""

    title: str = ""
    anchor: str = ""
    """Anchor in the page: lower-case letters, digits and hyphens."""
    blocks: list[Block] = field(default_factory=list)

    def say(self, text: str, *, warning: bool = False) -> None:
        """Add a paragraph."""
        self.blocks.append(Paragraph(text, warning))

    def items(self, texts: Iterable[str]) -> None:
        """Add a list of the non-empty texts."""
        if said := tuple(filter(None, texts)):
            self.blocks.append(Items(said))

    def verbatim(self, text: str) -> None:
        """Add lines that are shown unchanged."""
        self.blocks.append(Verbatim(text))

    def table(self, table: Table, *, folded: str = "") -> None:
        """Add a table; a table with a folded title is collapsed."""
        self.blocks.append(Details(folded, table) if folded else table)

    def picture(
        self, name: str, draw: Callable[[], Figure], caption: str, alternative: str
    ) -> None:
        """Add a plot."""
        self.blocks.append(Picture(name, draw, caption, alternative))


@dataclass(frozen=True, slots=True)
class Document:
    """A whole page, before it is written; its title has no marks."""

    title: str
    lead: Section
    sections: list[Section]

    @property
    def pictures(self) -> list[Picture]:
        """All plots of the sections, in order."""
        blocks = (block for section in self.sections for block in section.blocks)
        return [block for block in blocks if isinstance(block, Picture)]


def code(text: object) -> str:
    """Return a name or another text from a file as code."""
    return f"`{' '.join(str(text).split()).replace('`', chr(39))}`"


def literal(text: object) -> str:
    """Escape a text from a file, so that it is shown unchanged."""
    return re.sub(r"([\\`*\[\]])", r"\\\1", " ".join(str(text).split()))


def names(policies: Iterable[str]) -> str:
    """List policies in a sentence."""
    return ", ".join(map(code, policies))


def policy_table(
    groups: Mapping[str, Mapping[str, Sequence[Any]]],
    columns: Mapping[str, Cell],
    note: str = "",
) -> Table:
    """Return a row per policy, in groups under headings unless there is only one.

    Errors are counted below the policy's name; a policy without results has dashes.
    """
    rows: list[tuple[str, ...]] = []
    for title, results in groups.items():
        if len(groups) > 1:
            rows.append((f"**{title}**", *("" for _ in columns)))
        for policy, ran in counted(results).items():
            name = code(policy)
            own = results[policy]
            if failed := sum(bool(one.error) and not one.lost for one in own):
                name += f"\nerrors: {failed}"
            if lost := sum(one.lost for one in own):
                name += f"\nlost: {lost}"
            cells = (cell(ran) if ran else "–" for cell in columns.values())
            rows.append((name, *cells))
    return Table(columns=("policy", *columns), rows=tuple(rows), note=note)


def medians(*measures: Measure) -> dict[str, Cell]:
    """Return a column with the median of a measure; medians of others are below it."""

    def cell(results: Sequence[Any]) -> str:
        return "\n".join(one.text(one.median(results)) for one in measures)

    return {"\n".join(one.column for one in measures): cell}


FIGURES: Final = "figures"
"""Folder of the plots, beside the Markdown."""

_MARK: Final = re.compile(
    r"\\(?P<plain>.)"
    r"|`(?P<code>[^`]*)`"
    r"|\*\*(?P<bold>(?:`[^`]*`|\\.|[^`\\])+?)\*\*"
    # Links lead to web pages or to files in the same folder.
    r"|\[(?P<link>[^\]]+)\]\((?P<address>https?://[^)\s]+|(?!//)[\w./%~-]+)\)"
)


def inline(text: str) -> Markup:
    """Return a text of a document as HTML; everything except its marks is escaped."""
    written, end = Markup(), 0
    for mark in _MARK.finditer(text):
        # Concatenation and formatting with Markup escape other strings.
        written += text[end : mark.start()]
        match mark.lastgroup, mark[mark.lastgroup or 0]:
            case "code", code:
                written += Markup("<code>{}</code>").format(code)
            case "bold", bold:
                written += Markup("<b>{}</b>").format(inline(bold))
            case "address", address:
                link = Markup('<a href="{}">{}</a>')
                written += link.format(address, inline(mark["link"]))
            case _, plain:
                written += plain
        end = mark.end()
    return written + text[end:]


_TEMPLATES: Final = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.filters["marked"] = inline
_TEMPLATES.filters["kind"] = lambda block: type(block).__name__


def html_page(document: Document, images: Mapping[str, bytes]) -> str:
    """Return a document as HTML, from its template and the SVG of every picture."""
    embedded = {
        name: base64.b64encode(image).decode("ascii") for name, image in images.items()
    }
    page = _TEMPLATES.get_template("page.html.jinja")
    return page.render(document=document, images=embedded)


def markdown_page(document: Document) -> str:
    """Return a document as one text of Markdown."""
    parts = [f"# {document.title}", *map(_markdown, document.lead.blocks)]
    for section in document.sections:
        parts += [f"## {_unmarked(section.title)}", *map(_markdown, section.blocks)]
    return "\n\n".join(filter(None, parts)) + "\n"


def _markdown(block: Block) -> str:
    match block:
        case Paragraph(text=text, warning=warning):
            return f"> **Mind:** {_unmarked(text)}" if warning else _unmarked(text)
        case Items(texts=texts):
            return "\n".join(f"- {_unmarked(text)}" for text in texts)
        case Verbatim(text=text):
            # The fence is longer than any fence in the text.
            fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
            return f"{fence}text\n{text}\n{fence}"
        case Table(note=note):
            cells = markdown_table(block, _unmarked)
            return f"{cells}\n\n{_unmarked(note)}" if note else cells
        case Details(title=title, table=table):
            return f"**{_unmarked(title)}**\n\n{_markdown(table)}"
        case Picture(name=name, caption=caption, alternative=alternative):
            return f"![{alternative}]({FIGURES}/{name}.png)\n\n{_unmarked(caption)}"


def _unmarked(text: str) -> str:
    """Escape characters that are marks in Markdown, but not in a document."""
    return re.sub(
        r"(\\.|`[^`]*`)|([_<])",
        lambda found: found[1] or f"\\{found[2]}",
        text,
    )
