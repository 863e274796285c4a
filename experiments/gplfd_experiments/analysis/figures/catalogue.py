"""Every figure by name."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

from gplfd_experiments.analysis.figures import (
    fig02_heteroscedastic,
    fig03_alignment,
    fig04_via_points,
    fig06_policy,
    fig07_region,
    fig09_adaptation,
    fig10_stiffness,
    forecasts,
)
from gplfd_experiments.analysis.figures.material import PaperFigure

FIGURES: Final[Mapping[str, PaperFigure]] = MappingProxyType(
    {
        "fig02": fig02_heteroscedastic,
        "fig03": fig03_alignment,
        "fig04": fig04_via_points,
        "fig06": fig06_policy,
        "fig07": fig07_region,
        "fig09": fig09_adaptation,
        "fig10": fig10_stiffness,
        "forecasts": forecasts,
    }
)
"""Figures of the paper by their number, and one of our own."""


def chosen(names: Iterable[str]) -> dict[str, PaperFigure]:
    """Return figures by name, in the catalogue's order; all for no name.

    Raises:
        ValueError: A name that is not in the catalogue; the message lists those that
            are.
    """
    wanted = set(names)
    if unknown := sorted(wanted - set(FIGURES)):
        raise ValueError(
            f"there is no figure {unknown[0]!r}; figures: {', '.join(FIGURES)}"
        )
    return {name: one for name, one in FIGURES.items() if not wanted or name in wanted}
