"""A page as one HTML file: nothing to load, no script, wide tables scroll alone."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping
from typing import Final

from experiments.files.table import Table, html_table
from experiments.report.document import (
    Block,
    Document,
    Items,
    Paragraph,
    Picture,
    Section,
    Verbatim,
)

_STYLE: Final = """\
:root { color-scheme: light; --ink: #1c2230; --soft: #5a6373; --line: #d9dde5;
  --band: #f4f6f9; --accent: #7b2fb5; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; scroll-behavior: smooth; }
body { margin: 0 auto; max-width: 80rem; padding: 1rem 1rem 4rem; color: var(--ink);
  background: #fff; font: 1rem/1.55 system-ui, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0 .5rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
p { max-width: 46rem; margin: .6rem 0; overflow-wrap: anywhere; }
ul { columns: 2 30rem; column-gap: 2.5rem; margin: .6rem 0; padding-left: 1.2rem;
  overflow-wrap: anywhere; }
li { margin: 0 0 .5rem; break-inside: avoid; }
a { color: #1b5f9e; }
nav { margin: 1rem 0; padding: .6rem .8rem; background: var(--band);
  border-radius: .4rem; font-size: .92rem; }
nav a { display: inline-block; margin: .1rem .9rem .1rem 0; }
code { font: .92em ui-monospace, Menlo, Consolas, monospace; }
td code { white-space: nowrap; }
pre { overflow-x: auto; background: var(--band); padding: .7rem .8rem;
  font-size: .85rem; border-radius: .4rem; line-height: 1.45; }
.warning { border-left: .3rem solid #c8541b; background: #fdf2ea;
  padding: .5rem .8rem; }
.block { display: flex; flex-wrap: wrap; gap: .5rem 2rem; align-items: flex-start;
  margin: .8rem 0 1.4rem; }
.wide { overflow-x: auto; max-width: 100%; }
.note, figcaption { flex: 1 1 15rem; max-width: 46rem; margin: 0; color: var(--soft);
  font-size: .88rem; }
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
figure img { display: block; width: 56rem; min-width: 34rem; max-width: 100%;
  height: auto; }
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
        case Items(texts=texts):
            return f"<ul>{''.join(f'<li>{inline(text)}</li>' for text in texts)}</ul>"
        case Verbatim(text=text):
            return f"<pre>{html.escape(text)}</pre>"
        case Table(note=note):
            text = f'\n<p class="note">{inline(note)}</p>' if note else ""
            table = html_table(block, inline)
            return f'<div class="block">{_WIDE}{table}</div>{text}</div>'
        case Picture(name=name, caption=caption, alternative=alternative):
            image = base64.b64encode(images[name]).decode("ascii")
            return (
                f'<figure class="block">{_WIDE}<img alt="{html.escape(alternative)}" '
                f'src="data:image/svg+xml;base64,{image}"></div>\n'
                f"<figcaption>{inline(caption)}</figcaption></figure>"
            )
