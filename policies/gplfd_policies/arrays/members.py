"""Which members of a batch of episodes are meant."""

from typing import Final

import numpy as np
from jaxtyping import Int

Numbers = np.ndarray | np.float64 | np.int64
"""One number per member; arrays that lose all their axes become numbers of NumPy."""

Members = tuple[()] | Int[np.ndarray, " A"]
"""Index of the leading axis: the members' numbers, or the empty index for all."""

EVERY_MEMBER: Final = ()
"""All members, or the one of arrays without leading axis; makes views, not copies."""


def members_of(mask: np.ndarray | None, count: int) -> Members:
    """Return the members that a mask names.

    Args:
        mask: True for each member that is meant, (N,); None means all.
        count: Number of members N.

    Raises:
        ValueError: If the mask is not boolean of shape (N,).
    """
    if mask is None:
        return EVERY_MEMBER
    given = np.asarray(mask)
    if given.dtype != np.bool_ or given.shape != (count,):
        raise ValueError(
            f"mask must be boolean of shape ({count},), one entry per member, got "
            f"{given.dtype} of shape {given.shape}"
        )
    return EVERY_MEMBER if given.all() else np.flatnonzero(given)
