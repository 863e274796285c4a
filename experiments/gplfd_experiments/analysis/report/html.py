"""A page as one HTML file: nothing to load, no script, wide tables scroll alone."""

import base64
import html
import re
from collections.abc import Mapping
from typing import Final

from gplfd_experiments.analysis.report.document import (
    Block,
    Details,
    Document,
    Items,
    Paragraph,
    Picture,
    Section,
    Verbatim,
)
from gplfd_experiments.files.table import Table, html_table

_STYLE: Final = """\
:root { color-scheme: light; --ink: #1c2230; --soft: #5a6373; --line: #d9dde5;
  --band: #f4f6f9; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; scroll-behavior: smooth; }
body { margin: 0 auto; max-width: 100rem; padding: 1rem 1.5rem 4rem; color: var(--ink);
  background: #fff; font: 1rem/1.5 system-ui, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0 .5rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
p { margin: .6rem 0; overflow-wrap: anywhere; }
ul, .note { columns: 2 28rem; column-gap: 2.5rem; margin: .6rem 0; }
ul { padding-left: 1.2rem; overflow-wrap: anywhere; }
li { margin: 0 0 .5rem; break-inside: avoid; }
a { color: #1b5f9e; }
nav { margin: 1rem 0; padding: .6rem .8rem; background: var(--band);
  border-radius: .4rem; font-size: .92rem; }
nav a { display: inline-block; margin: .1rem .9rem .1rem 0; }
code { font: .92em ui-monospace, Menlo, Consolas, monospace; }
td code { white-space: nowrap; }
pre { overflow-x: auto; background: var(--band); padding: .7rem .8rem;
  font-size: .85rem; border-radius: .4rem; line-height: 1.45; }
summary { cursor: pointer; font-weight: 600; margin: .6rem 0; }
.warning { border-left: .3rem solid #c8541b; background: #fdf2ea;
  padding: .5rem .8rem; }
.wide { overflow-x: auto; }
.note, figcaption { color: var(--soft); font-size: .88rem; }
table { border-collapse: collapse; width: 100%; font-size: .84rem; line-height: 1.35;
  font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .4rem; border-bottom: 1px solid var(--line);
  text-align: right; vertical-align: top; white-space: nowrap; }
th { font-weight: 600; vertical-align: bottom; white-space: normal; }
.text td, .text th { text-align: left; white-space: normal; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0;
  background: #fff; white-space: normal; min-width: 6.5rem; }
tbody tr:nth-child(even) td { background: var(--band); }
tbody th { padding-top: .8rem; }
small { color: var(--soft); }
section { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr));
  gap: 0 2rem; }
section > * { grid-column: 1 / -1; min-width: 0; }
section > figure { grid-column: auto; margin: .8rem 0; }
section > figure:last-child:nth-of-type(odd) { grid-column: 1 / -1; display: grid;
  grid-template-columns: inherit; gap: inherit; align-items: center; }
@media (max-width: 75rem) { section, section > figure { display: block !important; } }
figure img { display: block; width: 100%; min-width: 34rem; height: auto; }
@media print { nav { display: none; } h2 { break-after: avoid; } }
"""


_WIDE: Final = '<div class="wide" tabindex="0">'
_MARK: Final = re.compile(
    r"\\(?P<plain>.)"
    r"|`(?P<code>[^`]*)`"
    r"|\*\*(?P<bold>(?:`[^`]*`|\\.|[^`\\])+?)\*\*"
    # Links lead to pages of the web or to files beside this one.
    r"|\[(?P<link>[^\]]+)\]\((?P<address>https?://[^)\s]+|(?!//)[\w./%~-]+)\)"
)


def html_page(document: Document, images: Mapping[str, bytes]) -> str:
    """Return the page as one text of HTML.

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
        f"<title>{html.escape(document.title)}</title>\n"
        f"<style>\n{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def inline(text: str) -> str:
    """Write a text with its bold parts, code and links, and all else escaped."""
    parts, end = [], 0
    for mark in _MARK.finditer(text):
        parts += [html.escape(text[end : mark.start()]), _element(mark)]
        end = mark.end()
    return "".join([*parts, html.escape(text[end:])])


def _element(mark: re.Match[str]) -> str:
    match mark.lastgroup, mark[mark.lastgroup or 0]:
        case "code", text:
            return f"<code>{html.escape(text)}</code>"
        case "bold", text:
            return f"<b>{inline(text)}</b>"
        case "address", address:
            target = html.escape(address)
            return f'<a href="{target}">{inline(mark["link"])}</a>'
        case _, text:
            return html.escape(text)


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
        case Items(texts=()):
            return ""
        case Items(texts=texts):
            return f"<ul>{''.join(f'<li>{inline(text)}</li>' for text in texts)}</ul>"
        case Verbatim(text=text):
            return f"<pre>{html.escape(text)}</pre>"
        case Table(note=note):
            text = f'\n<p class="note">{inline(note)}</p>' if note else ""
            return f"{_WIDE}{html_table(block, inline)}</div>{text}"
        case Details(title=title, table=table):
            summary = f"<summary>{html.escape(title)}</summary>"
            return f"<details>{summary}\n{_block(table, images)}</details>"
        case Picture(name=name, caption=caption, alternative=alternative):
            image = base64.b64encode(images[name]).decode("ascii")
            return (
                f'<figure>{_WIDE}<img alt="{html.escape(alternative)}" '
                f'src="data:image/svg+xml;base64,{image}"></div>\n'
                f"<figcaption>{inline(caption)}</figcaption></figure>"
            )
