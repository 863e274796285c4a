"""Records of a trial, and the contrasts of `gp` with its variants."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from gplfd_env.conventions.constants import Start
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII

BARS: Final = ("small", "medium", "large")
"""Doors of furniture, with a bar."""
MEDIUM: Final = ("medium",)


@dataclass(frozen=True, kw_only=True, slots=True)
class Level:
    """One setting of a trial: demonstrations, doors and circumstances.

    Other fields are as in `gplfd_experiments.episodes.task.EpisodeTask`.
    """

    doors: tuple[str, ...]
    """Names of doors, or radii [m] as text."""
    door: Mapping[str, Any] = field(default_factory=dict)
    """Fields of every door's configuration that differ from the preset."""
    randomization: str | Mapping[str, Any] = "none"
    disturbance: str | Mapping[str, Any] = "none"
    demonstrated_radii: tuple[float, ...] | None = DEMONSTRATED_RADII
    """None: those of the three demonstrated doors for a door of this kind."""
    demonstrated_kind: Mapping[str, str] | None = None
    """None: the kind of the opened door."""
    demonstrated_hardware: tuple[Mapping[str, Any], ...] = ()
    start: Start = "grasped"
    demonstrations_per_door: int = 2
    teacher: Mapping[str, float] = field(default_factory=dict)
    """Fields of the teacher that differ from the standard one."""
    habits: Mapping[str, Any] | None = None
    demonstrated_forces: bool = False
    prior_radius: float | None = None
    """Only methods that accept a prior mean take part."""
    corrections: int = 0
    """Number of corrections before the episode, at such doors; from 1 on, only policies
    that can be corrected take part."""
    demonstrated: bool = False
    """As in `gplfd_experiments.episodes.practice.Practice`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Side:
    """A policy at a level of a trial; at all levels together by default."""

    policy: str
    level: str = ""

    def __str__(self) -> str:
        return f"{self.policy}, {self.level}" if self.level else self.policy


@dataclass(frozen=True, kw_only=True, slots=True)
class Contrast:
    """Comparison by a measure of two policies that differ only in one idea."""

    idea: str
    measure: str
    having: Side
    lacking: Side


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """A question that episodes answer."""

    question: str
    claims: tuple[str, ...]
    """Tested rows of the paper's Table 1, or design ideas."""
    measures: tuple[str, ...]
    """Metrics of episodes that answer it, the deciding one first."""
    levels: Mapping[str, Level]
    """Settings by name, in the order in which they are shown."""
    contrasts: tuple[Contrast, ...] = ()
    """Contrasts that this trial decides."""
    extra_policies: tuple[str, ...] = ()
    """Policies that take part besides those of every trial and of the contrasts."""
    only_policies: tuple[str, ...] = ()
    """In the whole protocol, these replace the policies of every trial."""
    tuned: bool = False
    """Whether tuned methods also take part, because learning decides the trial."""

    @property
    def own(self) -> tuple[str, ...]:
        """Policies of this trial, besides those of every trial."""
        return (
            *(contrast.lacking.policy for contrast in self.contrasts),
            *self.extra_policies,
        )


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
