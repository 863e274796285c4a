"""Numbers of configuration records: each field declares its unit and its range once.

A record declares ``radius: float = quantity(0.5, unit="m", low=0.3, high=0.65)``,
explains the number in the docstring below, and calls `check_quantities` in its
``__post_init__``.
"""

import dataclasses
import math
import numbers
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np

Record = TypeVar("Record", bound=Any)

_RANGE: Final = "range"
"""Key of a field's metadata."""
_RANGED: Final = "a number or (low, high)"
"""Values that `check_ranges` allows, for messages."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """The numbers from `low` to `high`, greater than `above` and less than `below`.

    Also their unit (for whole numbers, the counted thing) and the reason of the limits.
    """

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    below: float = math.inf
    unit: str = ""
    reason: str = ""

    def __contains__(self, number: float) -> bool:
        return self.low <= number <= self.high and self.above < number < self.below

    def __str__(self) -> str:
        low = f"[{self.low:g}" if self.low > self.above else f"({self.above:g}"
        high = f"{self.high:g}]" if self.high < self.below else f"{self.below:g})"
        reason = f" ({self.reason})" if self.reason else ""
        return f"{low}, {high} {self.unit}".rstrip() + reason


def quantity(default: float | None, **allowed: Any) -> Any:
    """Declare a field that is a finite number; a whole one if annotated `int`.

    A default of None allows None. The other arguments are attributes of `Range`.
    """
    return dataclasses.field(default=default, metadata={_RANGE: Range(**allowed)})


def allowed_range(record: type, field: str) -> Range:
    """Return the range that a field of a record declares."""
    declared = {
        declaration.name: declaration for declaration in dataclasses.fields(record)
    }
    allowed: Range = declared[field].metadata[_RANGE]
    return allowed


def check_quantities(record: Any) -> None:
    """Check every declared number of a frozen record and make it a float or an int.

    Raises a TypeError if a value is not a number, a ValueError if it is not allowed.
    """
    for field in dataclasses.fields(record):
        absent = field.default is None and getattr(record, field.name) is None
        if _RANGE in field.metadata and not absent:
            checked = checked_count if field.type in (int, "int") else checked_number
            name = f"{type(record).__name__}.{field.name}"
            value = checked(name, getattr(record, field.name), field.metadata[_RANGE])
            object.__setattr__(record, field.name, value)


class Quantities:
    """A frozen record whose declared numbers are checked by `check_quantities`."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_quantities(self)


def check_ranges(record: Any) -> None:
    """Check every declared field of a frozen record: a number, or a pair of numbers.

    A number becomes a float, a pair ``(low, high)`` a tuple of floats. Raises the same
    errors as `check_quantities`, and a ValueError for a reversed pair.
    """
    for field in dataclasses.fields(record):
        if _RANGE in field.metadata:
            name = f"{type(record).__name__}.{field.name}"
            value, allowed = getattr(record, field.name), field.metadata[_RANGE]
            if isinstance(value, list | tuple):
                ends = tuple(checked_number(name, end, allowed) for end in value)
                if len(ends) != 2 or ends[0] > ends[1]:
                    raise ValueError(f"{name} = {value!r} must be {_RANGED}, low first")
                value = ends
            else:
                value = checked_number(name, value, allowed, _RANGED)
            object.__setattr__(record, field.name, value)


class Ranges:
    """A frozen record whose declared fields are checked by `check_ranges`."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_ranges(self)


def draw_ranges(record: Record, rng: np.random.Generator) -> Record:
    """Return a frozen record with a number drawn from every pair.

    One uniform number is drawn per declared field, also for fields without a pair.
    """
    declared = [
        field.name for field in dataclasses.fields(record) if _RANGE in field.metadata
    ]
    shares = zip(declared, rng.random(len(declared)).tolist(), strict=True)
    drawn = {}
    for name, share in shares:
        value = getattr(record, name)
        if isinstance(value, tuple):
            drawn[name] = value[0] + share * (value[1] - value[0])
    return dataclasses.replace(record, **drawn)


def checked_number(
    name: str, value: Any, allowed: Range, kind: str = "a number"
) -> float:
    """Return a value as a float; raise a TypeError, or a ValueError out of range."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(
            f"{name} must be {kind}, got {value!r} ({type(value).__name__})"
        )
    number = float(value)
    if number not in allowed:
        raise ValueError(f"{name} = {number!r} is outside {allowed}")
    return number


def checked_count(name: str, value: Any, allowed: Range) -> int:
    """Return a value as an int, or raise a ValueError."""
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or int(value) not in allowed:
        of = f" of {allowed.unit}" if allowed.unit else ""
        to = f" to {allowed.high:g}" if math.isfinite(allowed.high) else ""
        raise ValueError(
            f"{name} = {value!r} must be a whole number{of} from {allowed.low:g}{to}"
        )
    return int(value)


def check_choice(name: str, value: object, allowed: Collection[object]) -> None:
    """Raise a ValueError that lists the allowed values if a value is not among them."""
    if value not in tuple(allowed):
        raise ValueError(
            f"{name} = {value!r} is not one of {', '.join(map(repr, allowed))}"
        )
