"""Every figure by name."""

from __future__ import annotations

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
        "fig02": Entry(
            title="One noise level against a local one",
            make=fig02_heteroscedastic.make,
        ),
        "fig03": Entry(
            title="Alignment by distance and by task completion",
            make=fig03_alignment.make,
        ),
        "fig04": Entry(
            title="Strong and weak via-points",
            make=fig04_via_points.make,
        ),
        "fig06": Entry(
            title="From demonstrations to a policy, output by output",
            make=fig06_policy.make,
        ),
        "fig07": Entry(
            title="The policy on the plane of the door",
            make=fig07_region.make,
        ),
        "fig09": Entry(
            title="Adaptation while the door opens",
            make=fig09_adaptation.make,
            doors=fig09_adaptation.DOORS,
        ),
        "fig10": Entry(
            title="Stiffness and its stability",
            make=fig10_stiffness.make,
            doors=fig10_stiffness.DOORS,
        ),
        "forecasts": Entry(
            title="Forecasts of the rest of the opening",
            make=forecasts.make,
            doors=forecasts.DOORS,
        ),
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
