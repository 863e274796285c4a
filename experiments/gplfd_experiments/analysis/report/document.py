"""The content of a report, written as one HTML file and as Markdown beside its plots.

Texts may contain ``**bold**``, ```code``` and backslashes before characters that are
not marks. Texts from files go through `code` or `literal`.
"""

import base64
import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from gplfd_experiments.analysis.results.measures import ResultT
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_policies.registry.built_in import POLICIES
from gplfd_policies.registry.catalogue import policy_named, split_name

TOLD: Final = "told the door"
"""Kind of a policy that knows the door: it is listed, but never the reference."""

FIGURES: Final = "figures"  # Folder of the plots, beside the Markdown.


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph, a warning, or lines without marks such as error messages."""

    text: str
    kind: Literal["plain", "warning", "verbatim"] = "plain"


@dataclass(frozen=True, slots=True)
class Plot:
    """A plot, drawn with `figures.style.paper_style` when the page is written."""

    name: str  # Name of its files, without suffix.
    draw: Callable[[], Figure]
    caption: str
    alternative: str


Block = Text | Table | Plot


@dataclass(frozen=True, slots=True)
class Section:
    """A question under a heading, answered by tables and plots; first, the page's."""

    title: str
    blocks: Sequence[Block]


Cells = Sequence[tuple[str, str]]  # Headings and cells of a row.


def code(text: object) -> str:
    """Return a name or another text from a file as code."""
    return f"`{' '.join(str(text).split()).replace('`', chr(39))}`"


def literal(text: object) -> str:
    """Escape a text from a file, so that it is shown unchanged."""
    return re.sub(r"([\\`*\[\]])", r"\\\1", " ".join(str(text).split()))


def kind_of(policy: str) -> str:
    """Return the kind of a policy: method, ablation, reference, `TOLD` or own."""
    if split_name(policy)[0] not in POLICIES:
        return "own"
    try:
        known = policy_named(policy)
    except ValueError:  # a pipeline of another version
        return "ablation"
    return TOLD if known.told else known.kind


def policy_table(
    groups: Mapping[str, Mapping[str, Sequence[ResultT]]],
    row: Callable[[Sequence[ResultT]], Cells],
    *,
    title: str = "",
    note: str = "",
) -> Table:
    """Return a row per policy, in groups under headings unless there is only one.

    ``row`` returns the cells of the results of a policy that count. Errors are counted
    below the policy's name; a policy without results has dashes.
    """
    columns = ("policy", *(heading for heading, _ in row(())))
    rows: list[tuple[str, ...]] = []
    for heading, runs in groups.items():
        if len(groups) > 1 and heading:
            rows.append((f"**{literal(heading)}**", *[""] * (len(columns) - 1)))
        for policy, results in runs.items():
            kind, counting = kind_of(policy), [r for r in results if r.counts]
            name = code(policy) if kind == "method" else f"{code(policy)} ({kind})"
            lost = sum(result.lost for result in results)
            errors = sum(bool(result.error) for result in results) - lost
            for what, number in (("errors", errors), ("lost", lost)):
                name += f"\n{what}: {number}" if number else ""
            cells = (cell if counting else "–" for _, cell in row(counting))
            rows.append((name, *cells))
    return Table(columns=columns, rows=tuple(rows), title=title, note=note)


_MARK: Final = re.compile(r"\\(?P<plain>.)|`(?P<code>[^`]*)`|(?P<bold>\*\*)")


def inline(text: str) -> Markup:
    """Return a text of a document as HTML; everything except its marks is escaped."""
    bold = itertools.cycle(("<b>", "</b>"))
    html = _MARK.sub(
        lambda mark: (
            next(bold)
            if mark["bold"]
            else mark["plain"] or f"<code>{mark['code']}</code>"
        ),
        str(escape(text)),
    )
    return Markup(html)


_TEMPLATES: Final = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.filters["marked"] = inline


def html_page(page: Sequence[Section], images: Mapping[str, bytes]) -> str:
    """Return a page as HTML, from its template and the SVG of every plot."""
    encoded = {name: base64.b64encode(svg).decode() for name, svg in images.items()}
    anchors = [re.sub(r"[^a-z0-9]+", "-", section.title.lower()) for section in page]
    template = _TEMPLATES.get_template("page.html.jinja")
    return template.render(page=page, anchors=anchors, images=encoded)


def markdown_page(page: Sequence[Section]) -> str:
    """Return a page as one text of Markdown."""
    parts = []
    for section in page:
        marks = "#" if section is page[0] else "##"
        parts.append(f"{marks} {_unmarked(section.title)}")
        for block in section.blocks:
            match block:
                case Text(text, "verbatim"):
                    # The fence is longer than any fence in the text.
                    fences = map(len, re.findall("`+", text))
                    fence = "`" * max(3, 1 + max(fences, default=0))
                    parts.append(f"{fence}text\n{text}\n{fence}")
                case Text(text, kind):
                    parts.append("> **Mind:** " * (kind == "warning") + _unmarked(text))
                case Plot(name, _, caption, alternative):
                    parts.append(f"![{alternative}]({FIGURES}/{name}.png)")
                    parts.append(_unmarked(caption))
                case Table(title=title, note=note):
                    parts.append(f"**{_unmarked(title)}**" if title else "")
                    parts.append(markdown_table(block, _unmarked))
                    parts.append(_unmarked(note))
    return "\n\n".join(filter(None, parts)) + "\n"


def _unmarked(text: str) -> str:
    """Escape characters that are marks in Markdown, but not in a document."""
    return re.sub(r"(\\.|`[^`]*`)|([_<])", lambda mark: mark[1] or f"\\{mark[2]}", text)
