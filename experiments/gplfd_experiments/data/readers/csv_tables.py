"""Tables in text files: columns by comma, semicolon, tab or spaces.

Lines that begin with ``#`` are comments; an empty cell is a missing sample. If
semicolons separate columns, numbers may have decimal commas.
"""

import csv
from array import array
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.tables import named_columns, recording, understood
from gplfd_experiments.data.settings import ImportSettings


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion in a table; errors contain the line number."""
    with path.open(encoding="utf-8-sig", newline="") as stream:
        lines = _lines(stream)
        first = next(lines, None)
        if first is None:
            raise ValueError("it is empty")
        delimiter = next((mark for mark in "\t;," if mark in first[1]), " ")
        cells = _cells(first[1], delimiter)
        heads, where = settings.columns or cells, "--columns"
        try:
            for cell in cells:
                _number(cell, delimiter)
        except ValueError:
            where = where if settings.columns else "the header"
        else:
            if not settings.columns:
                raise ValueError(
                    f"its {len(cells)} columns have no names; give them in their "
                    "order, for example --columns t,x,y,z,qx,qy,qz,qw --units cm, with "
                    "- for one to leave out"
                )
            lines = chain([first], lines)
        places = named_columns(heads, where)
        values = array("d")
        for number, text in lines:
            cells = _cells(text, delimiter)
            if len(cells) != len(heads):
                raise ValueError(
                    f"line {number} has {len(cells)} columns, and {len(heads)} are "
                    f"named: {', '.join(heads)!s:.200}"
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
    units = [unit for _, unit in places.values()]
    columns = dict(zip(places, zip(table, units, strict=True), strict=True))
    # Unknown columns may be the time.
    names = [understood(head)[0] for head in heads]
    unused = [head for head in heads if head != "-" and understood(head)[0] is None]
    untimed = ""
    if None in names:
        names[names.index(None)] = "t"
        untimed = (
            f": its columns are {', '.join(heads)!s:.200}. If one of them is the time, "
            "name all in their order, for example --columns "
            f"{','.join(name or '-' for name in names)!s:.200}. Otherwise"
        )
    motion = recording(path.name, columns, settings, untimed)
    if unused:
        note = f"columns {', '.join(unused)!s:.200} are not used"
        motion = replace(motion, notes=(*motion.notes, note))
    return [motion]


def _lines(stream: TextIO) -> Iterator[tuple[int, str]]:
    """Yield number and text of every line that is neither empty nor a comment."""
    for number, text in enumerate(stream, start=1):
        if text.strip() and not text.lstrip().startswith("#"):
            yield number, text.strip("\r\n")


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]


def _number(cell: str, delimiter: str) -> float:
    if not cell:
        return float("nan")
    return float(cell.replace(",", ".") if delimiter == ";" else cell)
