"""Tables in text files: columns by comma, semicolon, tab or spaces.

The file is read line by line. Lines that begin with ``#`` are comments; an empty cell
is a missing sample. The first line names the columns with their units, unless
``--columns`` does. Where semicolons part the columns, numbers may have decimal commas.
"""

import csv
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, TextIO

import numpy as np

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.selection import Selection
from gplfd_experiments.data.readers.tables import (
    NAMES,
    named_columns,
    recording,
    understood,
)

_LONGEST_LINE: Final = 2**16
"""Characters of a line at most: a table of poses has a few hundred."""


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read one recording from a table in a text file.

    Raises:
        ValueError: The file is no such table; the message says in which line.
    """
    with path.open(encoding="utf-8-sig", errors="strict", newline="") as stream:
        lines = _lines(stream)
        first = next(lines, None)
        if first is None:
            raise ValueError("it is empty")
        number, text = first
        delimiter = _delimiter(text)
        cells = _cells(text, delimiter)
        has_header = not all(_is_number(cell, delimiter) for cell in cells)
        heads: Sequence[str] = selection.columns or cells
        if not (has_header or selection.columns):
            raise ValueError(
                f"its {len(cells)} columns have no names; give them in their order, "
                "for example --columns t,x,y,z,qx,qy,qz,qw --units cm, with - for one "
                "to leave out"
            )
        found = named_columns(heads, "--columns" if selection.columns else "the header")
        places = [place for place, _ in found.values()]
        values = array("d")
        if not has_header:
            _add(values, number, cells, heads, places, delimiter)
        for number, text in lines:
            cells = _cells(text, delimiter)
            _add(values, number, cells, heads, places, delimiter)
    table = np.frombuffer(values).reshape(-1, len(places))
    columns = {name: table[:, place] for place, name in enumerate(found)}
    units = {name: unit for name, (_, unit) in found.items()}
    return [recording(path.name, columns, units, selection, _untimed(heads))]


def _untimed(heads: Sequence[str]) -> str:
    """Return how to say which column is the time, where none is understood as it."""
    names = [understood(head)[0] for head in heads]
    unknown = [place for place, name in enumerate(names) if name not in NAMES]
    if not unknown:
        return ""
    first, *others = unknown
    names[first] = "t"
    for place in others:
        names[place] = "-"
    return (
        f": its columns are {', '.join(heads)!s:.200}. If one of them is the time, "
        f"name all in their order, for example --columns {','.join(names)!s:.200}. "
        "Otherwise"
    )


def _lines(stream: TextIO) -> Iterator[tuple[int, str]]:
    """Yield number and text of every line that is neither empty nor a comment."""
    number = 0
    while text := stream.readline(_LONGEST_LINE):
        number += 1
        if len(text) == _LONGEST_LINE:
            raise ValueError(f"line {number} has {_LONGEST_LINE} characters or more")
        if "\0" in text:
            raise ValueError(f"line {number} holds a zero byte: this is no text")
        if text.strip() and not text.lstrip().startswith("#"):
            yield number, text.strip("\r\n")


def _delimiter(text: str) -> str:
    for delimiter in ("\t", ";", ","):
        if delimiter in text:
            return delimiter
    return " "


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]


def _is_number(cell: str, delimiter: str) -> bool:
    try:
        _number(cell, delimiter)
    except ValueError:
        return False
    return True


def _number(cell: str, delimiter: str) -> float:
    if not cell:
        return float("nan")
    return float(cell.replace(",", ".") if delimiter == ";" else cell)


def _add(
    values: "array[float]",
    number: int,
    cells: Sequence[str],
    heads: Sequence[str],
    places: Sequence[int],
    delimiter: str,
) -> None:
    """Add the chosen numbers of a line."""
    if len(cells) != len(heads):
        raise ValueError(
            f"line {number} has {len(cells)} columns, and {len(heads)} are named: "
            f"{', '.join(heads)!s:.200}"
        )
    for place in places:
        try:
            values.append(_number(cells[place], delimiter))
        except ValueError:
            name = understood(heads[place])[0]
            raise ValueError(
                f"line {number}, column {place + 1} ({name}): {cells[place]!r:.40} is "
                "no number"
            ) from None
