"""Rows of a batch: the episodes to which a call applies."""

from typing import Final

import numpy as np

from gplfd_policies.arrays.shapes import Float, Int

Numbers = np.ndarray | np.float64 | np.int64
"""One number per row; a NumPy scalar for a batch without a leading axis."""
PerRow = Float[Numbers, "*N"]  # Such floating-point numbers, e.g. phases or loads.

Rows = tuple[()] | Int[np.ndarray, " A"]
"""Index of the leading axis: numbers of rows, or the empty index for all rows."""

ALL_ROWS: Final = ()
"""All rows, also for arrays without a leading axis; gives views, not copies."""


def rows_of(mask: np.ndarray | None, count: int) -> Rows:
    """Return the rows that a mask (N,) selects; None selects all."""
    if mask is None:
        return ALL_ROWS
    selected = np.asarray(mask)
    if selected.dtype != np.bool_ or selected.shape != (count,):
        raise ValueError(
            f"mask must be boolean of shape ({count},), one entry per member, got "
            f"{selected.dtype} of shape {selected.shape}"
        )
    return ALL_ROWS if selected.all() else np.flatnonzero(selected)
