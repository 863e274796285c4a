"""Numbers of configuration records: each field declares its unit and its range once.

A record declares ``radius: float = quantity(0.5, unit="m", low=0.3, high=0.65)``, says
in the docstring below what the number means, and calls `check_quantities` in its
``__post_init__``.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

_RANGE: Final = "range"
"""Key of a field's metadata."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """The finite numbers that are allowed, and their unit."""

    low: float = -math.inf
    """Least number."""

    high: float = math.inf
    """Greatest number."""

    above: bool = False
    """Whether `low` itself is outside."""

    below: bool = False
    """Whether `high` itself is outside."""

    unit: str = ""
    """Their unit; of whole numbers, what they count."""

    reason: str = ""
    """What sets the limits, for messages."""

    def __contains__(self, number: float) -> bool:
        enough = number > self.low if self.above else number >= self.low
        within = number < self.high if self.below else number <= self.high
        return enough and within and math.isfinite(number)

    def __str__(self) -> str:
        left = "(" if self.above or self.low == -math.inf else "["
        right = ")" if self.below or self.high == math.inf else "]"
        reason = f" ({self.reason})" if self.reason else ""
        return f"{left}{self.low:g}, {self.high:g}{right} {self.unit}".rstrip() + reason


def quantity(
    default: float,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    above: float | None = None,
    below: float | None = None,
    reason: str = "",
) -> Any:
    """Declare a field of a dataclass: a finite number; a whole one if annotated `int`.

    Args:
        default: Its value if none is given.
        unit: Its unit; of a whole number, what it counts.
        low: Least value allowed.
        high: Greatest value allowed.
        above: In place of `low`: the value must be greater than this.
        below: In place of `high`: the value must be less than this.
        reason: What sets the limits, for messages.
    """
    allowed = Range(
        low=low if above is None else above,
        high=high if below is None else below,
        above=above is not None,
        below=below is not None,
        unit=unit,
        reason=reason,
    )
    return dataclasses.field(default=default, metadata={_RANGE: allowed})


def allowed_range(record: type, field: str) -> Range:
    """Return what a record's field declared."""
    declared: Range = record.__dataclass_fields__[field].metadata[_RANGE]  # type: ignore[attr-defined]
    return declared


def check_quantities(record: Any) -> None:
    """Check every declared number of a frozen record and make it a float or an int.

    Raises:
        ValueError: A number is not finite or not allowed.
        TypeError: A value is not a number.
    """
    for field in dataclasses.fields(record):
        if _RANGE not in field.metadata:
            continue
        checked = checked_count if field.type in (int, "int") else checked_number
        name = f"{type(record).__name__}.{field.name}"
        value = checked(name, getattr(record, field.name), field.metadata[_RANGE])
        object.__setattr__(record, field.name, value)


def checked_number(name: str, value: object, allowed: Range) -> float:
    """Return a value as a float.

    Args:
        name: What messages call it.
        value: To be checked.
        allowed: The numbers that it may be.

    Raises:
        ValueError: It is not finite or not allowed.
        TypeError: It is not a number.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(
            f"{name} must be a number, got {value!r} ({type(value).__name__})"
        )
    if float(value) not in allowed:
        raise ValueError(f"{name} = {float(value)!r} is outside {allowed}")
    return float(value)


def checked_count(name: str, value: object, allowed: Range) -> int:
    """Return a value as an int; arguments as of `checked_number`.

    Raises:
        ValueError: It is not a whole number or not allowed.
    """
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or int(value) not in allowed:  # type: ignore[call-overload]
        of = f" of {allowed.unit}" if allowed.unit else ""
        to = f" to {allowed.high:g}" if math.isfinite(allowed.high) else ""
        raise ValueError(
            f"{name} = {value!r} must be a whole number{of} from {allowed.low:g}{to}"
        )
    return int(value)  # type: ignore[call-overload, no-any-return]


def check_choice(name: str, value: object, allowed: Collection[object]) -> None:
    """Raise unless a value is one of those allowed.

    Raises:
        ValueError: It is not; the message lists them.
    """
    if value not in allowed:
        raise ValueError(
            f"{name} = {value!r} is not one of {', '.join(map(repr, allowed))}"
        )
