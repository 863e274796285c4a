"""What figures are made from, and what they are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from matplotlib.figure import Figure

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.demonstrations.npz import LabelledDemonstrations


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Everything a figure may show."""

    seed: int
    """Seed of all of it, and of whatever random set a figure makes itself."""
    demonstrations: LabelledDemonstrations
    """Openings of the three demonstrated doors; what the episodes' policy learned."""
    episodes: Mapping[str, EpisodeLog]
    """One episode of the policy ``gp`` per door, by the door's name."""


class PaperFigure(Protocol):
    """A figure in three steps: a module with these names."""

    @property
    def TITLE(self) -> str:
        """Its subject, in a few words."""

    @property
    def DOORS(self) -> tuple[str, ...]:
        """Doors whose episodes it shows: names or radii in metres."""

    def measure(self, material: Material, /) -> Any:
        """Compute everything that is shown; the others take what this returns."""

    def draw(self, shown: Any, /) -> Figure:
        """Draw what was measured."""

    def caption(self, shown: Any, /) -> str:
        """Say in a paragraph what is seen, what the paper showed, and the numbers."""
