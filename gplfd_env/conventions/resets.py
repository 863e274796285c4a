"""Gymnasium's conventions for reset options, seeds and masks."""

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.constants import Mask

Record = TypeVar("Record")

Seeds = int | Sequence[int | None] | NDArray[np.integer[Any]] | None
"""One seed, from which the others are counted up, or a seed or None per simulation."""


def checked_options(options: object, allowed: Mapping[str, str]) -> dict[str, Any]:
    """Return the options of a reset that are not None; refuse unknown ones."""
    if not isinstance(options, Mapping | None):
        raise ValueError(
            f'options must be a mapping as {{"door": "small"}}, not {options!r}'
        )
    named = options or {}
    unknown = [repr(name) for name in named if name not in allowed]
    if unknown:
        choices = [f'"{name}" ({meaning})' for name, meaning in allowed.items()]
        names = ", ".join(unknown)
        raise ValueError(
            f"unknown reset option(s) {names}; allowed: {', '.join(choices)}"
        )
    return {name: value for name, value in named.items() if value is not None}


def masked(values: Mapping[str, Any], rows: Mask) -> dict[str, Any]:
    """Add to each value, also nested ones, a mask ``"_key"`` of its valid rows."""
    inner = {name: value for name, value in values.items() if isinstance(value, dict)}
    nested = {name: masked(unmasked(value), rows) for name, value in inner.items()}
    masks = dict.fromkeys(_mask_names(tuple(values)), rows.copy())
    return {**values, **nested, **masks}


@lru_cache(maxsize=64)
def _mask_names(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"_{name}" for name in names)


def unmasked(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values without their masks; masks of nested values stay."""
    return {name: value for name, value in values.items() if not name.startswith("_")}


def each(
    name: str, values: Any, n: int | None, resolve: Callable[[Any], Record]
) -> list[Record]:
    """Return a value per simulation from one or n; n is None for a single one."""
    if n is None or not isinstance(values, list | tuple):
        return [resolve(values)] * (n or 1)
    if len(values) != n:
        raise ValueError(
            f"{name} must be one for all or a sequence of {n}, got {len(values)}"
        )
    return [resolve(value) for value in values]


def each_seed(seed: Seeds, n: int) -> list[int | None]:
    """Return the seed of every simulation, or raise a ValueError."""
    if seed is None or isinstance(seed, int | np.integer):
        return [None if seed is None else int(seed) + row for row in range(n)]
    try:
        seeds = [None if value is None else operator.index(value) for value in seed]
    except TypeError:
        seeds = []
    if len(seeds) != n:
        raise ValueError(f"seed must be an integer or a sequence of {n}, got {seed!r}")
    return seeds


def chosen_rows(mask: Any, n: int, *, begun: bool) -> Mask:
    """Return which simulations to reset, (n,); the first reset must include all."""
    if mask is None:
        return np.ones(n, dtype=bool)
    array = np.asarray(mask)
    if array.shape != (n,) or array.dtype != np.bool_ or not array.any():
        raise ValueError(f"reset_mask must be {n} booleans, not all False: {mask!r}")
    if not begun and not array.all():
        raise ValueError("the first reset must reset all simulations; omit the mask")
    return array
