"""Report of a comparison: a table of numbers, and targets for some of them."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from gplfd_experiments.console.progress import LOG
from gplfd_experiments.files.table import Table, text_table
from gplfd_experiments.speed.timing import Timing

Value = float | Timing | str | None
"""A number, a time, a word, or None."""


@dataclass(frozen=True, slots=True)
class Target:
    """A measured number, its limits as text, and whether it is within them."""

    name: str
    value: float
    wanted: str
    met: bool


def at_most(name: str, value: float, limit: float) -> Target:
    """Return a target for a number that should be small."""
    return Target(name, value, f"at most {limit:g}", value <= limit)


def at_least(name: str, value: float, limit: float) -> Target:
    """Return a target for a number that should be large."""
    return Target(name, value, f"at least {limit:g}", value >= limit)


def between(name: str, value: float, low: float, high: float) -> Target:
    """Return a target for a number that should be neither small nor large."""
    return Target(name, value, f"{low:g} to {high:g}", low <= value <= high)


@dataclass(frozen=True, kw_only=True, slots=True)
class Measurement:
    """Results of a comparison; names of columns contain the units."""

    title: str
    rows: Mapping[str, Mapping[str, Value]]
    targets: tuple[Target, ...] = ()


def value_table(rows: Mapping[str, Mapping[str, Value]]) -> Table:
    """Return a line per row; missing values are dashes."""
    columns = tuple(dict.fromkeys(column for row in rows.values() for column in row))

    def text(value: Value) -> str:
        if value is None:
            return "-"
        if isinstance(value, float | int):
            # Four significant digits, and all digits before the point.
            return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
        return str(value)

    return Table(
        columns=("", *columns),
        rows=tuple(
            (name, *(text(row.get(column)) for column in columns))
            for name, row in rows.items()
        ),
    )


def measure_all(
    measures: Mapping[str, Callable[[], Measurement]],
) -> dict[str, Measurement]:
    """Run measurements in turn with one BLAS thread, and print the results."""
    found = {}
    with threadpool_limits(1):
        for name, run in measures.items():
            LOG.info("measuring: %s", name)
            one = found[name] = run()
            print(one.title, text_table(value_table(one.rows)), "", sep="\n")
    targets: dict[str, dict[str, Value]] = {}
    for target in itertools.chain.from_iterable(one.targets for one in found.values()):
        row = targets[target.name] = {"measured": target.value, "wanted": target.wanted}
        row[""] = "met" if target.met else "MISSED"
    print("targets", text_table(value_table(targets)), sep="\n")
    return found
