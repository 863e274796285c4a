"""Contrasts of the trials: `gp` compared with its variants that lack an idea."""

from collections.abc import Mapping
from typing import Final

from gplfd_experiments.studies.trials.records import Contrast, Side

CONSTANT: Final = tuple(f"gp-constant-{k}" for k in (100, 500))
"""`gp` at constant stiffnesses."""

_LACKING: Final[Mapping[str, tuple[str, ...]]] = {
    "via-points": ("gp-fixed",),
    "size and phase together": ("gp-one-size",),
    "forecast with size": ("gp-process",),
    "progress beyond the demonstrations": ("gp-within-demonstrations",),
    "task variability": ("gp-homoscedastic",),
    "heteroscedastic noise": ("gp-homoscedastic",),
    "rotations": ("gp-position-only",),
    "variable stiffness": CONSTANT,
    "learned load": ("gp-carried-load",),
    "demonstrated forces": ("gp-without-forces",),
    "damping for contact": ("gp-undamped",),
    "several modes": ("gp-one-mode",),
}
"""Variants that lack an idea."""
SIZES: Final = ("size and phase together", "forecast with size")
RADIAL: Final = "force_radial_peak"
GENTLE: Final = (RADIAL, "success")
"""Measures of opening a door with a small force."""
OPENED: Final = ("success", "force_handle_peak")


def contrasts(measure: str, *ideas: str, level: str = "") -> tuple[Contrast, ...]:
    """Compare `gp` with all variants that lack one of the ideas."""
    return tuple(
        Contrast(
            idea=idea,
            measure=measure,
            having=Side(policy="gp", level=level),
            lacking=Side(policy=policy, level=level),
        )
        for idea in ideas
        for policy in _LACKING[idea]
    )


def compared_levels(idea: str, measure: str, having: str, lacking: str) -> Contrast:
    """Compare two levels of `gp`, one with the idea and one without it."""
    return Contrast(
        idea=idea,
        measure=measure,
        having=Side(policy="gp", level=having),
        lacking=Side(policy="gp", level=lacking),
    )
