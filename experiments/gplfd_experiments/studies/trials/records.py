"""Records of a trial."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from gplfd_env.conventions.constants import Start
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII

RADIAL: Final = "force_radial_peak"
"""Measure that decides most trials of a gentle opening."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Level:
    """One setting of a trial; other fields are as in `episodes.task.EpisodeTask`."""

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
    levels: Mapping[str, Level]
    """Settings by name, in the order in which they are shown."""
    measures: Sequence[str] = ("success", "force_handle_peak")
    """Metrics of episodes that answer it, the deciding one first."""
    contrasts: tuple[Contrast, ...] = ()
    """Contrasts that this trial decides."""
    extra_policies: Sequence[str] = ()
    """Policies that take part besides those of every trial and of the contrasts."""
    only_policies: Sequence[str] = ()
    """In the whole protocol, these replace the policies of every trial."""
    tuned: bool = False
    """Whether tuned methods also take part, because learning decides the trial."""

    @property
    def own(self) -> tuple[str, ...]:
        """Policies of this trial, besides those of every trial."""
        lacking = (contrast.lacking.policy for contrast in self.contrasts)
        return (*lacking, *self.extra_policies)
