"""What every part of the benchmark reports: tables for people, targets to hold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

NOT_INSTALLED = "not installed"


@dataclass(frozen=True, kw_only=True, slots=True)
class Table:
    """Cells of text under a title."""

    title: str
    """What was measured."""
    columns: tuple[str, ...]
    """Heads with units."""
    rows: tuple[tuple[str, ...], ...]
    """Lines; the first cell names the line."""

    def __str__(self) -> str:
        """The title and aligned columns, names to the left and numbers to the right."""
        lines = (self.columns, *self.rows)
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        aligned = (
            "  ".join(
                cell.rjust(width) if place else cell.ljust(width)
                for place, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        )
        return "\n".join([self.title, *(f"  {line}" for line in aligned)])


@dataclass(frozen=True, kw_only=True, slots=True)
class Target:
    """A number to hold."""

    name: str
    """What is measured, with its unit."""
    value: float
    """What was measured."""
    low: float | None = None
    """Least value that meets the target; None: no lower limit."""
    high: float | None = None
    """Greatest value that meets the target; None: no upper limit."""

    @property
    def met(self) -> bool:
        """Whether the value is within the limits."""
        above = self.low is None or self.value >= self.low
        return above and (self.high is None or self.value <= self.high)


class Result(Protocol):
    """What a part of the benchmark measured; a frozen record."""

    def tables(self) -> tuple[Table, ...]:
        """The record for people."""

    def targets(self) -> tuple[Target, ...]:
        """The numbers to hold, as far as they were measured."""


def target_table(targets: Iterable[Target]) -> Table:
    """Tabulate targets, measured values and whether they are met."""
    return Table(
        title="targets",
        columns=("", "measured", "wanted", ""),
        rows=tuple(
            (
                target.name,
                f"{target.value:.4g}",
                _limits(target),
                "met" if target.met else "MISSED",
            )
            for target in targets
        ),
    )


def _limits(target: Target) -> str:
    if target.low is None:
        return f"at most {target.high:g}"
    if target.high is None:
        return f"at least {target.low:g}"
    return f"{target.low:g} to {target.high:g}"


def number(value: float | None, digits: int = 3) -> str:
    """Fixed-point text; a dash for what was not measured."""
    return "-" if value is None else f"{value:.{digits}f}"
