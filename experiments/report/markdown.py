"""A page as Markdown, its plots as files beside it."""

from __future__ import annotations

import re
from typing import Final

from experiments.report.document import (
    Block,
    Document,
    Items,
    Paragraph,
    Picture,
    Table,
    Verbatim,
)

FIGURES: Final = "figures"
"""Folder of the plots, beside the page."""


def markdown_page(document: Document) -> str:
    """Write a page."""
    parts = [f"# {document.title}", *(_block(block) for block in document.lead)]
    for section in document.sections:
        parts.append(f"## {section.title}")
        parts.extend(_block(block) for block in section.blocks)
    return "\n\n".join(parts) + "\n"


def _block(block: Block) -> str:
    match block:
        case Paragraph(text=text, warning=warning):
            return f"> **Mind:** {_shown(text)}" if warning else _shown(text)
        case Items(texts=texts):
            return "\n".join(f"- {_shown(text)}" for text in texts)
        case Verbatim(text=text):
            return f"````text\n{text}\n````"
        case Table():
            return _table(block)
        case Picture(name=name, caption=caption, alternative=alternative):
            return f"![{alternative}]({FIGURES}/{name}.png)\n\n{_shown(caption)}"


def _table(table: Table) -> str:
    rule = [":--" if table.left or not place else "--:" for place in _places(table)]
    lines = [
        "| " + " | ".join(_cell(cell) for cell in row) + " |"
        for row in (table.columns, *table.rows)
    ]
    lines.insert(1, "| " + " | ".join(rule) + " |")
    return "\n".join(lines) + (f"\n\n{_shown(table.note)}" if table.note else "")


def _cell(text: str) -> str:
    return _shown(text).replace("|", "\\|").replace("\n", "<br>")


def _places(table: Table) -> range:
    return range(len(table.columns))


def _shown(text: str) -> str:
    """Keep what is no mark of ours from being one of Markdown's."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        part if part.startswith("`") else re.sub(r"([_<])", r"\\\1", part)
        for part in parts
    )
