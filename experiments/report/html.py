"""A page as one HTML file: nothing to load, no script, wide tables scroll alone."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping
from typing import Final

from experiments.report.document import (
    Block,
    Document,
    Items,
    Paragraph,
    Picture,
    Section,
    Table,
    Verbatim,
)

_STYLE: Final = """\
:root { color-scheme: light; --ink: #1c2230; --soft: #5a6373; --line: #d9dde5;
  --band: #f4f6f9; --accent: #7b2fb5; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; scroll-behavior: smooth; }
body { margin: 0 auto; max-width: 74rem; padding: 1rem 1rem 4rem; color: var(--ink);
  background: #fff; font: 1rem/1.55 system-ui, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0 .5rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
p, ul { max-width: 46rem; margin: .6rem 0; overflow-wrap: anywhere; }
ul { padding-left: 1.2rem; } li { margin: .3rem 0; }
a { color: #1b5f9e; }
nav { margin: 1rem 0; padding: .6rem .8rem; background: var(--band);
  border-radius: .4rem; font-size: .92rem; }
nav a { display: inline-block; margin: .1rem .9rem .1rem 0; }
code { font: .92em ui-monospace, Menlo, Consolas, monospace; white-space: nowrap; }
pre { overflow-x: auto; background: var(--band); padding: .7rem .8rem;
  font-size: .85rem; border-radius: .4rem; line-height: 1.45; }
.warning { border-left: .3rem solid #c8541b; background: #fdf2ea;
  padding: .5rem .8rem; }
.wide { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .88rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .55rem; border-bottom: 1px solid var(--line);
  text-align: right; vertical-align: top; white-space: nowrap; }
th { font-weight: 600; vertical-align: bottom; white-space: normal; min-width: 3.6rem; }
.text td, .text th { text-align: left; white-space: normal; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0;
  background: #fff; white-space: normal; min-width: 6.5rem; max-width: 12rem; }
tbody tr:nth-child(even) td { background: var(--band); }
small { color: var(--soft); }
.note { color: var(--soft); font-size: .88rem; }
figure { margin: 1rem 0; }
figure img { display: block; width: 100%; min-width: 34rem; max-width: 56rem;
  height: auto; }
figcaption { color: var(--soft); font-size: .9rem; max-width: 46rem; }
@media print { nav { display: none; } h2 { break-after: avoid; } }
"""


def html_page(document: Document, images: Mapping[str, bytes]) -> str:
    """Write a page.

    Args:
        document: What it says.
        images: SVG of every picture by name.
    """
    contents = "".join(
        f'<a href="#{one.anchor}">{inline(one.title)}</a>' for one in document.sections
    )
    body = "\n".join(
        [
            f"<h1>{inline(document.title)}</h1>",
            *(_block(block, images) for block in document.lead),
            f"<nav>{contents}</nav>",
            *(_section(section, images) for section in document.sections),
        ]
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(plain(document.title))}</title>\n"
        f"<style>\n{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def inline(text: str) -> str:
    """Write a text with its bold parts, code and links."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        f"<code>{html.escape(part[1:-1])}</code>"
        if part.startswith("`") and part.endswith("`") and len(part) > 1
        else _marked(html.escape(part))
        for part in parts
    )


def plain(text: str) -> str:
    """Return a text without its marks."""
    return re.sub(r"\*\*|`", "", text)


def _marked(escaped: str) -> str:
    bold = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", escaped)
    return re.sub(r"\[([^\]]+)\]\(([^)\s]+)\)", r'<a href="\2">\1</a>', bold)


def _section(section: Section, images: Mapping[str, bytes]) -> str:
    blocks = "\n".join(_block(block, images) for block in section.blocks)
    return (
        f'<section id="{section.anchor}">\n<h2>{inline(section.title)}</h2>\n'
        f"{blocks}\n</section>"
    )


def _block(block: Block, images: Mapping[str, bytes]) -> str:
    match block:
        case Paragraph(text=text, warning=warning):
            kind = ' class="warning"' if warning else ""
            return f"<p{kind}>{inline(text)}</p>"
        case Items(texts=texts):
            return f"<ul>{''.join(f'<li>{inline(text)}</li>' for text in texts)}</ul>"
        case Verbatim(text=text):
            return f"<pre>{html.escape(text)}</pre>"
        case Table():
            return _table(block)
        case Picture():
            return _picture(block, images[block.name])


def _table(table: Table) -> str:
    heads = "".join(f'<th scope="col">{inline(head)}</th>' for head in table.columns)
    rows = "\n".join(
        f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row)}</tr>"
        for row in table.rows
    )
    note = f'\n<p class="note">{inline(table.note)}</p>' if table.note else ""
    kind = ' class="text"' if table.left else ""
    return (
        f'<div class="wide" tabindex="0"><table{kind}>\n<thead><tr>{heads}</tr></thead>'
        f"\n<tbody>\n{rows}\n</tbody>\n</table></div>{note}"
    )


def _cell(text: str) -> str:
    first, _, second = text.partition("\n")
    return inline(first) + (f"<br><small>{inline(second)}</small>" if second else "")


def _picture(picture: Picture, image: bytes) -> str:
    data = base64.b64encode(image).decode("ascii")
    return (
        f'<figure><div class="wide" tabindex="0"><img alt="'
        f'{html.escape(picture.alternative)}" src="data:image/svg+xml;base64,{data}">'
        f"</div>\n<figcaption>{inline(picture.caption)}</figcaption></figure>"
    )
