"""Tiers of the protocol: trials that are ranked together."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

TIERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "furniture": ("radius", "further", "few", "messy", "rests", "turned", "heavy"),
        "buildings": ("buildings",),
        "other motions": ("motions",),
        "realistic conditions": (
            *("handle-pose", "two-modes", "few-doors", "another-handle"),
        ),
        "forces": (
            *("forces-weight", "forces-closer", "forces-person"),
            *("forces-blocked", "forces-seal"),
        ),
    }
)
"""Names of trials by tier. The tier furniture has the trials of protocol v2 in which
the share of opened doors separates pairs of methods other than `gp-paper` (signed ranks
of 20 seeds, Holm, 5 %). A tier without trials is not run yet."""
