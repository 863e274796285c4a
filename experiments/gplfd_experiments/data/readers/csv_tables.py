"""Tables in text files: columns by comma, semicolon, tab or spaces.

Unless commas separate columns, numbers may have decimal commas. Lines of names are
joined, as in files of Motive.
"""

import csv
import io
import re
from array import array
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers import tables
from gplfd_experiments.data.settings import ImportSettings

_MISSING: Final = frozenset(("", "-", "na", "n/a", "#n/a", "null", "none", "nil"))
_MOST_HEADS: Final = 100
"""Largest number of lines before the first sample."""


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion in a table; errors contain the line number."""
    lines = _lines(path.read_bytes())
    delimiter = _delimiter(lines)
    top = [_cells(text, delimiter) for _, text in lines[:_MOST_HEADS]]
    heads, first = _heads(top, settings, delimiter)
    where = "--columns" if settings.columns else "the header"
    places = tables.named_columns(heads, where, settings.body)
    values = array("d")
    for number, text in lines[first:]:
        cells = _cells(text, delimiter)
        if len(cells) < len(heads) or any(cells[len(heads) :]):
            named = f"{len(heads)} are named: {tables.listed(heads)}"
            raise ValueError(f"line {number} has {len(cells)} columns, and {named}")
        for name, (place, _) in places.items():
            value = _number(cells[place], delimiter)
            if value is None:
                raise ValueError(
                    f"line {number}, column {place + 1} ({name}): {cells[place]!r:.40} "
                    "is no number"
                )
            values.append(value)
    table = np.frombuffer(values).reshape(-1, len(places)).T
    columns = {
        name: (numbers, unit)
        for numbers, (name, (_, unit)) in zip(table, places.items(), strict=True)
    }
    if top[0][0] == "Format Version":  # What Motive states in its first line.
        stated = dict(zip(top[0][::2], top[0][1::2], strict=False))
        length = tables.UNIT_WORDS.get(stated.get("Length Units", "").lower())
        for name in columns.keys() & set(tables.POSITION):
            columns[name] = (columns[name][0], columns[name][1] or length)
        if settings.angles is None and "rx" in columns:
            euler = f"euler-{stated.get('Rotation Type', 'XYZ')}-deg"
            settings = replace(settings, angles=euler)
    used = {place for place, _ in places.values()}
    unused = [head for place, head in enumerate(heads) if place not in used]
    motion = tables.recording(path.name, columns, settings, unused)
    if settings.body and not any(tables.understood(head)[2] for head in heads):
        note = "--body has no effect: the names of its columns are of no body"
        motion = replace(motion, notes=(*motion.notes, note))
    return [motion]


def _lines(content: bytes) -> list[tuple[int, str]]:
    """Return number and text of every line that is neither empty nor a comment."""
    encoding = "utf-8-sig"
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif b"\0" in content[:2]:
        encoding = "utf-16-be" if content[:1] == b"\0" else "utf-16-le"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    lines = [
        (number, line.strip("\r\n"))
        for number, line in enumerate(io.StringIO(text, newline=""), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise ValueError("it is empty")
    return lines


def _delimiter(lines: list[tuple[int, str]]) -> str:
    """Return what separates columns; a line such as ``sep=;`` says it, and goes."""
    if separated := re.fullmatch(r"sep=(.+)", lines[0][1].strip(" \"'")):
        lines.pop(0)
        return separated[1].replace("\\t", "\t")
    text = lines[:_MOST_HEADS][-1][1]
    marks = [*(mark for mark in "\t;," if mark in text), " "]
    for mark in marks:
        if all(_number(cell, mark) is not None for cell in _cells(text, mark)):
            return mark
    return marks[0]


def _heads(
    rows: list[list[str]], settings: ImportSettings, delimiter: str
) -> tuple[Sequence[str], int]:
    """Return the names of the columns, and the index of the row of the first sample."""
    columns = settings.columns
    in_order = columns if not any("=" in column for column in columns) else ()
    used = [at for at, head in enumerate(in_order) if tables.understood(head)[0]]
    wanted = {column.partition("=")[2] for column in columns}
    for index, cells in enumerate(rows):
        numeric = [_number(cell, delimiter) is not None for cell in cells]
        names = [tables.understood(cell)[0] for cell in cells]
        if in_order:
            if len(cells) >= len(in_order) and all(numeric[at] for at in used):
                return in_order, index
        elif len(cells) > 1 and cells[0] and all(numeric):
            if index == 0:
                raise ValueError(
                    f"its {len(cells)} columns have no names; give them in their "
                    "order, --columns t,x,y,z,..., with - for one to leave out"
                )
            break
        elif {"x", "y"} <= set(names) or (wanted and wanted <= set(cells)):
            heads = cells
            if len(set(names) - {None}) < len(names) - names.count(None):
                # The names of bodies and of quantities are in the lines above.
                above = [row for row in rows[:index] if len(row) == len(cells)]
                joined = map(" ".join, zip(*above, cells, strict=True))
                heads = [
                    cell if name == "t" else words.strip()
                    for cell, name, words in zip(cells, names, joined, strict=True)
                ]
            return tables.renamed(heads, columns), index + 1
    return tables.renamed(rows[0], columns), min(1, len(rows) - 1)


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]


def _number(cell: str, delimiter: str) -> float | None:
    """Return the number in a cell, NaN for a missing one, None for a text."""
    if cell.lower() in _MISSING:
        return float("nan")
    try:
        return float(cell if delimiter == "," else cell.replace(",", "."))
    except ValueError:
        return None
