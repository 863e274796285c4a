"""A table of texts, and its formats for a terminal and in Markdown."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, kw_only=True, slots=True)
class Table:
    """Texts in rows; the first cell of each row names it."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Cells, one per heading; text after a line break is small. A row with only its
    first cell is the heading of the rows below."""
    title: str = ""  # Title of a table that a page shows folded.
    note: str = ""
    left: bool = False
    """Whether all cells are left-aligned text, instead of numbers after a name."""

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, str]]) -> "Table":
        """Return the table of rows with the same keys."""
        heads = tuple(rows[0]) if rows else ()
        return cls(columns=heads, rows=tuple(tuple(row.values()) for row in rows))


FIRST: Final = 5  # Number of columns that commands print unless all are asked for.


def text_table(table: Table, columns: int | None = None) -> str:
    """Write the first columns, or all, aligned and without marks."""
    lines = [
        [part.replace("**", "").replace("`", "") for part in line[:columns]]
        for row in (table.columns, *table.rows)
        for line in itertools.zip_longest(*map(str.splitlines, row), fillvalue="")
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if table.left or not place else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def markdown_table(table: Table, write: Callable[[str], str] = str) -> str:
    """Write a table of GitHub's Markdown; ``write`` writes the text of a cell."""
    marks = str.maketrans({"|": "\\|", "\n": "<br>"})
    # "[a] [b]" would be a link to b.
    head, *rows = (
        [write(cell).replace("] [", "] \\[").translate(marks) for cell in row]
        for row in (table.columns, *table.rows)
    )
    rule = [":--" if table.left or not place else "--:" for place in range(len(head))]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))
