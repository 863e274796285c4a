"""Tables in text files: columns by comma, semicolon, tab or spaces.

Lines that begin with ``#`` are comments; an empty cell or ``NA`` is a missing sample.
Unless commas separate columns, numbers may have decimal commas. Lines before the names
of columns are skipped, and names in several lines are joined, as in files of Motive.
"""

import csv
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Final, TextIO

import numpy as np

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.tables import (
    POSITION,
    UNIT_WORDS,
    listed,
    named_columns,
    recording,
    renamed,
    understood,
)
from gplfd_experiments.data.settings import ImportSettings

_MISSING: Final = frozenset(("", "-", "na", "n/a", "#n/a", "null", "none", "nil"))
_MOST_HEADS: Final = 100
"""Largest number of lines before the first sample."""


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion in a table; errors contain the line number."""
    with path.open("rb") as stream:
        start = stream.read(2)
    marked = start in (b"\xff\xfe", b"\xfe\xff")
    if marked or b"\0" in start:
        unmarked = "utf-16-be" if start[:1] == b"\0" else "utf-16-le"
        return [_read(path, settings, "utf-16" if marked else unmarked)]
    try:
        return [_read(path, settings, "utf-8-sig")]
    except UnicodeDecodeError:
        return [_read(path, settings, "latin-1")]


def _read(path: Path, settings: ImportSettings, encoding: str) -> RawRecording:
    with path.open(encoding=encoding, newline="") as stream:
        rows = _lines(stream)
        lines = list(islice(rows, _MOST_HEADS))
        if not lines:
            raise ValueError("it is empty")
        delimiter = _delimiter(lines)
        head = [(number, _cells(text, delimiter)) for number, text in lines]
        heads, first = _heads(head, settings, delimiter)
        where = "--columns" if settings.columns else "the header"
        places = named_columns(heads, where, settings.body)
        values = array("d")
        more = ((number, _cells(text, delimiter)) for number, text in rows)
        for number, cells in chain(head[first:], more):
            if len(cells) < len(heads) or any(cells[len(heads) :]):
                raise ValueError(
                    f"line {number} has {len(cells)} columns, and {len(heads)} are "
                    f"named: {listed(heads)}"
                )
            for name, (place, _) in places.items():
                try:
                    values.append(_number(cells[place], delimiter))
                except ValueError:
                    raise ValueError(
                        f"line {number}, column {place + 1} ({name}): "
                        f"{cells[place]!r:.40} is no number"
                    ) from None
    table = np.frombuffer(values).reshape(-1, len(places)).T
    units = {name: unit for name, (_, unit) in places.items()}
    if head[0][1][0] == "Format Version":  # What Motive states in its first line.
        stated = dict(zip(head[0][1][::2], head[0][1][1::2], strict=False))
        length = UNIT_WORDS.get(stated.get("Length Units", "").lower())
        units |= {name: units[name] or length for name in POSITION if name in units}
        if settings.angles is None and "rx" in units:
            euler = f"euler-{stated.get('Rotation Type', 'XYZ')}-deg"
            settings = replace(settings, angles=euler)
    columns = dict(zip(places, zip(table, units.values(), strict=True), strict=True))
    # Unknown columns may be the time.
    used = {place for place, _ in places.values()}
    names = [understood(head)[0] for head in heads]
    unused = [
        head
        for place, head in enumerate(heads)
        if place not in used and head.lower() not in ("", "-", "frame", "index")
    ]
    untimed = ""
    if unused:
        likely = heads.index(unused[0])
        named = ["t" if place == likely else n or "-" for place, n in enumerate(names)]
        untimed = (
            f": its columns are {listed(heads)}. If one of them is the time, name it, "
            f"for example --columns 't={unused[0]}', or all in their order, --columns "
            f"{','.join(named)!s:.200}. Otherwise"
        )
    motion = recording(path.name, columns, settings, untimed, unused)
    if settings.body and not any(understood(head)[2] for head in heads):
        note = "--body has no effect: the names of its columns are of no body"
        motion = replace(motion, notes=(*motion.notes, note))
    return motion


def _lines(stream: TextIO) -> Iterator[tuple[int, str]]:
    """Yield number and text of every line that is neither empty nor a comment."""
    for number, text in enumerate(stream, start=1):
        if text.strip() and not text.lstrip().startswith("#"):
            yield number, text.strip("\r\n")


def _delimiter(lines: list[tuple[int, str]]) -> str:
    """Return what separates columns; a line such as ``sep=;`` says it, and goes."""
    if separated := re.fullmatch(r"sep=(.+)", lines[0][1].strip(" \"'")):
        lines.pop(0)
        return separated[1].replace("\\t", "\t")
    text = lines[-1][1]
    marks = [*(mark for mark in "\t;," if mark in text), " "]

    def numeric(mark: str) -> bool:
        return all(_is_number(cell, mark) for cell in _cells(text, mark))

    return next(filter(numeric, marks), marks[0])


def _heads(
    rows: list[tuple[int, list[str]]], settings: ImportSettings, delimiter: str
) -> tuple[Sequence[str], int]:
    """Return the names of the columns, and the index of the row of the first sample."""
    columns = settings.columns
    if columns and not any("=" in column for column in columns):
        named = [place for place, name in enumerate(columns) if understood(name)[0]]
        for index, (_, cells) in enumerate(rows):
            fits = len(cells) >= len(columns)
            if fits and all(_is_number(cells[place], delimiter) for place in named):
                return columns, index
        return columns, min(1, len(rows) - 1)
    for index, (_, cells) in enumerate(rows):
        numeric = all(_is_number(cell, delimiter) for cell in cells)
        if len(cells) > 1 and cells[0] and numeric:
            if index == 0:
                raise ValueError(
                    f"its {len(cells)} columns have no names; give them in their "
                    "order, for example --columns t,x,y,z,qx,qy,qz,qw --units cm, with "
                    "- for one to leave out"
                )
            break
        names = [understood(cell)[0] for cell in cells]
        wanted = {column.partition("=")[2] for column in columns}
        if {"x", "y"} <= set(names) or (wanted and wanted <= set(cells)):
            heads = cells
            if index and len(set(names) - {None}) < len(names) - names.count(None):
                # The names of bodies and of quantities are in the lines above.
                above = [other for _, other in rows[:index] if len(other) == len(cells)]
                joined = map(" ".join, zip(*above, cells, strict=True))
                heads = [
                    cell if name == "t" else words.strip()
                    for cell, name, words in zip(cells, names, joined, strict=True)
                ]
            return renamed(heads, columns), index + 1
    return renamed(rows[0][1], columns), 1


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]


def _number(cell: str, delimiter: str) -> float:
    if cell.lower() in _MISSING:
        return float("nan")
    return float(cell if delimiter == "," else cell.replace(",", "."))


def _is_number(cell: str, delimiter: str) -> bool:
    try:
        _number(cell, delimiter)
    except ValueError:
        return False
    return True
