"""What every comparison reports: a table of numbers, and targets that they meet."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from experiments.speed.timing import Timing

Value = float | Timing | str | None
"""A number, a time, a word, or nothing where there is none."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Target:
    """A number, and what is wanted of it."""

    name: str
    """What is measured, with its unit."""
    value: float
    """The number as it was measured."""
    wanted: str
    """The limits in words."""
    met: bool
    """Whether the value is within them."""


def at_most(name: str, value: float, limit: float) -> Target:
    """Return a target for a number that should be small."""
    return Target(
        name=name, value=value, wanted=f"at most {limit:g}", met=value <= limit
    )


def at_least(name: str, value: float, limit: float) -> Target:
    """Return a target for a number that should be large."""
    return Target(
        name=name, value=value, wanted=f"at least {limit:g}", met=value >= limit
    )


def between(name: str, value: float, low: float, high: float) -> Target:
    """Return a target for a number that should be neither small nor large."""
    met = low <= value <= high
    return Target(name=name, value=value, wanted=f"{low:g} to {high:g}", met=met)


@dataclass(frozen=True, kw_only=True, slots=True)
class Measurement:
    """Everything that one comparison measured."""

    title: str
    """What was measured, and how."""
    rows: Mapping[str, Mapping[str, Value]]
    """Values by line and column, whose names have the units."""
    targets: tuple[Target, ...] = ()
    """What was wanted of some of the numbers."""


def text_table(title: str, rows: Mapping[str, Mapping[str, Value]]) -> str:
    """Return aligned text: names to the left, values to the right.

    Args:
        title: First line.
        rows: Values by line and column. Columns stand in the order in which lines first
            name them; a line that lacks one has a dash there.
    """
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    lines = [["", *columns]]
    for name, row in rows.items():
        lines.append([name, *(_text(row.get(column)) for column in columns)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    text = [title]
    for name, *cells in lines:
        aligned = [name.ljust(widths[0]), *map(str.rjust, cells, widths[1:])]
        text.append(f"  {'  '.join(aligned)}".rstrip())
    return "\n".join(text)


def _text(value: Value) -> str:
    """Four significant digits of a number, and all before the point."""
    if value is None:
        return "-"
    if isinstance(value, float | int):
        return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return str(value)


def measure_all(
    measures: Mapping[str, Callable[[int], Measurement]], repeats: int
) -> dict[str, Measurement]:
    """Measure one after the other with one BLAS thread, and print what was found.

    Args:
        measures: What to run, by name.
        repeats: Measurements of every time.
    """
    found = {}
    with threadpool_limits(1):
        for name, run in measures.items():
            print(f"measuring: {name}", file=sys.stderr, flush=True)
            found[name] = run(repeats)
            print(text_table(found[name].title, found[name].rows), end="\n\n")
    targets: dict[str, dict[str, Value]] = {
        target.name: {
            "measured": target.value,
            "wanted": target.wanted,
            "": "met" if target.met else "MISSED",
        }
        for one in found.values()
        for target in one.targets
    }
    print(text_table("targets", targets))
    return found
