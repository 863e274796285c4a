"""A document as one HTML file, and as Markdown with its plots as files beside it."""

import base64
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from gplfd_experiments.analysis.report.document import (
    Block,
    Details,
    Document,
    Items,
    Paragraph,
    Picture,
    Verbatim,
)
from gplfd_experiments.files.table import Table, markdown_table

FIGURES: Final = "figures"
"""Folder of the plots, beside the Markdown."""

_MARK: Final = re.compile(
    r"\\(?P<plain>.)"
    r"|`(?P<code>[^`]*)`"
    r"|\*\*(?P<bold>(?:`[^`]*`|\\.|[^`\\])+?)\*\*"
    # Links lead to pages of the web or to files beside this one.
    r"|\[(?P<link>[^\]]+)\]\((?P<address>https?://[^)\s]+|(?!//)[\w./%~-]+)\)"
)


def inline(text: str) -> Markup:
    """Return a text of a document as HTML; everything but its marks is escaped."""
    written, end = Markup(), 0
    for mark in _MARK.finditer(text):
        # Adding to markup, and formatting it, escapes what is not markup itself.
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
    """Return a document as HTML, by its template and the SVG of every picture."""
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
            # A fence is longer than any in the text.
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
    """Escape what Markdown would read as a mark and a document does not."""
    return re.sub(
        r"(\\.|`[^`]*`)|([_<])",
        lambda found: found[1] or f"\\{found[2]}",
        text,
    )
