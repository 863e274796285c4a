"""A page as Markdown, its plots as files beside it."""

import re
from typing import Final

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
"""Folder of the plots, beside the page."""


def markdown_page(document: Document) -> str:
    """Return the page as one text of Markdown."""
    parts = [f"# {document.title}", *map(_block, document.lead)]
    for section in document.sections:
        parts += [f"## {_shown(section.title)}", *map(_block, section.blocks)]
    return "\n\n".join(filter(None, parts)) + "\n"


def _block(block: Block) -> str:
    match block:
        case Paragraph(text=text, warning=warning):
            return f"> **Mind:** {_shown(text)}" if warning else _shown(text)
        case Items(texts=texts):
            return "\n".join(f"- {_shown(text)}" for text in texts)
        case Verbatim(text=text):
            # A fence is longer than any in the text.
            fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
            return f"{fence}text\n{text}\n{fence}"
        case Table(note=note):
            cells = markdown_table(block, _shown)
            return f"{cells}\n\n{_shown(note)}" if note else cells
        case Details(title=title, table=table):
            return f"**{_shown(title)}**\n\n{_block(table)}"
        case Picture(name=name, caption=caption, alternative=alternative):
            return f"![{alternative}]({FIGURES}/{name}.png)\n\n{_shown(caption)}"


def _shown(text: str) -> str:
    """Keep what is no mark of ours from being one of Markdown's."""
    return re.sub(
        r"(\\.|`[^`]*`)|([_<])",
        lambda found: found[1] or f"\\{found[2]}",
        text,
    )
