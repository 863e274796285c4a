"""Arithmetic for one simulation and for n: floats, or arrays of shape (n,).

NumPy's overhead makes arrays of one element ten times slower than Python's floats, and
loops over simulations make n of them slow. Code written with the functions below and
with +, -, *, /, comparisons, & and | accepts both and gives the same bits, because
these operations are exact or correctly rounded in both. NumPy's sine, cosine,
arctangent and hypotenuse differ from those of `math`, so `math` is called for each
element.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Number = float | NDArray[Any]
"""A float (or int), or an array of them, (n,)."""
Flag = bool | NDArray[np.bool_]
"""A bool, or an array of them, (n,)."""
Record = TypeVar("Record")
"""Tuples, dictionaries and dataclasses, nested, with numbers and flags in them."""


def where(condition: Flag, yes: Number, no: Number) -> Number:
    """Return `yes` where the condition holds, else `no`."""
    if condition is True:
        return yes
    if condition is False:
        return no
    return np.where(condition, yes, no)


def negated(flag: Flag) -> Flag:
    """Return the opposite of a flag."""
    return not flag if flag is True or flag is False else ~flag


def anywhere(flag: Flag) -> bool:
    """Return whether a flag is true for any simulation."""
    return flag if flag is True or flag is False else bool(np.count_nonzero(flag))


def larger(first: Number, second: Number) -> Number:
    """Return the larger one of two numbers."""
    return where(first >= second, first, second)


magnitude: Final[Callable[[Number], Number]] = cast("Any", abs)
"""Absolute value."""


def sqrt(number: Number) -> Number:
    """Return the square root."""
    if isinstance(number, np.ndarray):
        return np.sqrt(number)
    return math.sqrt(number)


def _by_element(function: Callable[..., float]) -> Callable[..., Number]:
    """Return a function of `math` that also takes arrays."""

    def of(*numbers: Number) -> Number:
        if not isinstance(numbers[0], np.ndarray):
            return function(*numbers)
        return np.array(list(map(function, *(np.asarray(x).tolist() for x in numbers))))

    return of


sin, cos = _by_element(math.sin), _by_element(math.cos)
atan2, hypot = _by_element(math.atan2), _by_element(math.hypot)


def columns(components: Sequence[Number], n: int) -> NDArray[np.float64]:
    """Return a vector of k numbers as a new array (n, k), for n simulations."""
    result = np.empty((n, len(components)))
    for place, component in enumerate(components):
        result[:, place] = component
    return result


def mapped(function: Callable[..., Any], *records: Any) -> Any:
    """Apply a function to the entries of equally structured records."""
    first = records[0]
    if isinstance(first, dict):
        return {x: mapped(function, *[y[x] for y in records]) for x in first}
    if isinstance(first, tuple):
        parts = [mapped(function, *entries) for entries in zip(*records, strict=True)]
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    if not dataclasses.is_dataclass(first) or isinstance(first, type):
        return function(*records)
    names = [field.name for field in dataclasses.fields(first)]
    values = {x: mapped(function, *[getattr(y, x) for y in records]) for x in names}
    return dataclasses.replace(first, **values)


def stacked(records: Sequence[Record]) -> Record:
    """Return the records of n simulations as one record with array entries (n,)."""
    result: Record = mapped(lambda *entries: np.array(entries), *records)
    return result


def by_row(vector: Sequence[Number]) -> list[tuple[Any, ...]]:
    """Return the components of a vector as n tuples, one per simulation."""
    parts = [x.tolist() if isinstance(x, np.ndarray) else [x] for x in vector]
    return list(zip(*parts, strict=True))


def with_rows(record: Record, n: int, rows: Sequence[int], ones: Any) -> Record:
    """Return a record of n simulations with the values of some of them replaced."""

    def replaced(entry: Any, *new: Any) -> Any:
        result = np.array(np.broadcast_to(entry, n))
        result[rows] = new
        return result

    result: Record = mapped(replaced, record, *ones)
    return result
