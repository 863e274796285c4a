"""Exact dynamic time warping in NumPy."""

from collections.abc import Callable

import numpy as np

from gplfd_policies.arrays.shapes import Float, Int

LARGEST_TABLE = 10**8
"""Greatest number of cells: two sequences of 10,000, a few seconds and 100 MB."""

_DIAGONAL, _UP, _LEFT = np.int8(0), np.int8(1), np.int8(2)


def dynamic_time_warping(
    cost_row: Callable[[int], Float[np.ndarray, " M"]], n_rows: int
) -> tuple[Int[np.ndarray, " P"], Int[np.ndarray, " P"]]:
    """Match two sequences with steps (1, 0), (0, 1), (1, 1) of equal weight.

    Returns the indices of the first and of the second sequence along the match with
    least cost. They never decrease, and ends are matched to ends.

    The recursion D_ij = c_ij + min(D_{i-1,j}, D_{i-1,j-1}, D_{i,j-1}) runs along each
    row without a loop: with S the cumulated cost of the row and v_j the cheaper of the
    two entries above, D_ij - S_j = min over l ≤ j of (v_l - S_{l-1}), a running
    minimum. Memory is one byte per cell.
    """
    total = np.cumsum(cost_row(0))
    if n_rows * len(total) > LARGEST_TABLE:
        raise ValueError(
            f"dynamic time warping of {n_rows:,} and {len(total):,} samples compares "
            f"each with each, at most {LARGEST_TABLE:,} pairs: give demonstrations of "
            '10,000 samples or fewer, or align by method="interpolation" (policy gp), '
            "which takes any number"
        )
    above = np.empty_like(total)
    choices = np.empty((n_rows, len(total)), dtype=np.int8)
    choices[0] = _LEFT
    for index in range(1, n_rows):
        costs = cost_row(index)
        choice = choices[index, 1:]
        np.less(total[1:], total[:-1], out=choice.view(np.bool_))  # up or diagonal
        above[0] = total[0]
        np.minimum(total[1:], total[:-1], out=above[1:])
        cumulated = costs.cumsum()
        total = cumulated + np.minimum.accumulate(above - (cumulated - costs))
        choices[index, 0] = _UP
        np.copyto(choice, _LEFT, where=total[:-1] < above[1:])
    # Follow the choices from the last cell back to the first.
    row, column = choices.shape[0] - 1, choices.shape[1] - 1
    path = [(row, column)]
    while row or column:
        choice = choices[row, column]
        row -= choice != _LEFT
        column -= choice != _UP
        path.append((row, column))
    rows, columns = np.array(path[::-1], dtype=np.int64).T
    return rows, columns
