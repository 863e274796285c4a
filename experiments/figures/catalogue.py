"""Every figure by name."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

from experiments.figures import (
    fig02_heteroscedastic,
    fig03_alignment,
    fig04_via_points,
    fig06_policy,
    fig07_region,
    fig09_adaptation,
    fig10_stiffness,
    forecasts,
)
from experiments.figures.material import Entry

FIGURES: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "fig02": fig02_heteroscedastic.FIGURE,
        "fig03": fig03_alignment.FIGURE,
        "fig04": fig04_via_points.FIGURE,
        "fig06": fig06_policy.FIGURE,
        "fig07": fig07_region.FIGURE,
        "fig09": fig09_adaptation.FIGURE,
        "fig10": fig10_stiffness.FIGURE,
        "forecasts": forecasts.FIGURE,
    }
)
"""Figures of the paper by their number, and one of our own."""


def chosen(names: Iterable[str]) -> dict[str, Entry]:
    """Return figures by name, in the catalogue's order; all for no name.

    Raises:
        ValueError: A name that is not in the catalogue; the message lists those that
            are.
    """
    wanted = set(names)
    unknown = sorted(wanted - set(FIGURES))
    if unknown:
        raise ValueError(
            f"there is no figure {unknown[0]!r}; figures: {', '.join(FIGURES)}"
        )
    return {
        name: entry for name, entry in FIGURES.items() if not wanted or name in wanted
    }
