"""Fields of configuration records: each declares its unit and range, or its choices.

A record declares ``radius: float = quantity(0.5, unit="m", low=0.3, high=0.65)``,
explains the number in the docstring below, and calls `check_quantities` in its
``__post_init__``.
"""

import dataclasses
import math
import numbers
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

Record = TypeVar("Record", bound=Any)

_RANGE: Final = "range"  # Key of a field's metadata; likewise:
_CHOICES: Final = "choices"


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """The numbers from `low` to `high`, greater than `above` and less than `below`."""

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    below: float = math.inf
    unit: str = ""
    reason: str = ""
    pairs: bool = False

    def __contains__(self, number: float) -> bool:
        return self.low <= number <= self.high and self.above < number < self.below

    def __str__(self) -> str:
        low = f"[{self.low:g}" if self.low > self.above else f"({self.above:g}"
        high = f"{self.high:g}]" if self.high < self.below else f"{self.below:g})"
        reason = f" ({self.reason})" if self.reason else ""
        return f"{low}, {high} {self.unit}".rstrip() + reason


def quantity(default: float | None, **allowed: Any) -> Any:
    """Declare a number in `Range(**allowed)`, whole if annotated `int`, or None."""
    return dataclasses.field(default=default, metadata={_RANGE: Range(**allowed)})


def choice(default: Any, allowed: Any) -> Any:
    """Declare one of the values of a `Literal`."""
    return dataclasses.field(default=default, metadata={_CHOICES: get_args(allowed)})


def allowed_range(record: type, field: str) -> Range:
    """Return the range that a field of a record declares."""
    declared = {x.name: x.metadata for x in dataclasses.fields(record)}
    allowed: Range = declared[field][_RANGE]
    return allowed


def check_quantities(record: Any) -> None:
    """Make every declared number a float or an int, a pair a tuple of floats.

    Raises a TypeError if a value is not a number, a ValueError if it is not allowed.
    """
    for field in dataclasses.fields(record):
        value: Any = getattr(record, field.name)
        name = f"{type(record).__name__}.{field.name}"
        if _CHOICES in field.metadata:
            check_choice(name, value, field.metadata[_CHOICES])
        allowed = field.metadata.get(_RANGE)
        if allowed is None or (field.default is None and value is None):
            continue
        checked: Any
        if allowed.pairs and isinstance(value, list | tuple):
            checked = tuple(checked_number(name, end, allowed) for end in value)
            if len(checked) != 2 or checked[0] > checked[1]:
                kind = "a number or (low, high), low first"
                raise ValueError(f"{name} = {value!r} must be {kind}")
        elif field.type in (int, "int"):
            checked = checked_count(name, value, allowed)
        else:
            checked = checked_number(name, value, allowed)
        object.__setattr__(record, field.name, checked)


class Quantities:
    """A frozen record whose declared numbers are checked by `check_quantities`."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_quantities(self)


def draw_ranges(record: Record, rng: np.random.Generator) -> Record:
    """Return a record with a number drawn from, or for, every declared field."""
    fields = [field for field in dataclasses.fields(record) if _RANGE in field.metadata]
    declared = [field.name for field in fields]
    shares = zip(declared, rng.random(len(declared)).tolist(), strict=True)
    drawn = {}
    for name, share in shares:
        value = getattr(record, name)
        if isinstance(value, tuple):
            drawn[name] = value[0] + share * (value[1] - value[0])
    return dataclasses.replace(record, **drawn)


def checked_number(name: str, value: Any, allowed: Range) -> float:
    """Return a value as a float; raise a TypeError, or a ValueError out of range."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        kind = "a number or (low, high)" if allowed.pairs else "a number"
        got = f"{value!r} ({type(value).__name__})"
        raise TypeError(f"{name} must be {kind}, got {got}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf if abs(value) == value else -math.inf
    if number not in allowed:
        raise ValueError(f"{name} = {number!r} is outside {allowed}")
    return number


def checked_count(name: str, value: Any, allowed: Range) -> int:
    """Return a value as an int, or raise a ValueError."""
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or int(value) not in allowed:
        of = f" of {allowed.unit}" if allowed.unit else ""
        to = f" to {allowed.high:g}" if math.isfinite(allowed.high) else ""
        kind = f"a whole number{of} from {allowed.low:g}{to}"
        raise ValueError(f"{name} = {value!r} must be {kind}")
    return int(value)


def real_array(value: object) -> NDArray[np.float64]:
    """Return a new array of real numbers; refuse complex ones, dates, texts, masks."""
    array = np.array(value)
    exact = array.dtype.kind in "biuf" or (
        array.dtype.kind == "O" and all(isinstance(x, numbers.Real) for x in array.flat)
    )
    if isinstance(value, np.ma.MaskedArray) or not exact:
        raise TypeError(f"not an array of real numbers: {array.dtype}")
    return array.astype(np.float64, copy=False)


def check_choice(name: str, value: object, allowed: Collection[object]) -> None:
    """Raise a ValueError that lists the allowed values if a value is not among them."""
    if value not in tuple(allowed):
        names = ", ".join(map(repr, allowed))
        raise ValueError(f"{name} = {value!r} is not one of {names}")
