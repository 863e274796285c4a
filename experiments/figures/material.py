"""What figures are made from, and what they are."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from experiments.datasets.npz import LabelledDemonstrations
from experiments.episodes.log import EpisodeLog


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Everything a figure may show."""

    seed: int
    """Seed of all of it, and of whatever random set a figure makes itself."""
    demonstrations: LabelledDemonstrations
    """Openings of the three demonstrated doors; what the episodes' policy learned."""
    episodes: Mapping[str, EpisodeLog]
    """One episode of the policy ``gp`` per door, by the door's name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Drawing:
    """A figure with its caption."""

    figure: Figure
    """The figure, not yet written anywhere."""
    caption: str
    """One paragraph: what is seen, what the paper showed, what differs, numbers."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """One figure of the catalogue, in three steps."""

    title: str
    """Its subject, in a few words."""
    measure: Callable[[Material], Any]
    """Computes everything that is shown; the others take what it returns."""
    draw: Callable[[Any], Figure]
    """Draws what was measured."""
    caption: Callable[[Any], str]
    """Says what is seen, and the numbers."""
    doors: tuple[str, ...] = ()
    """Doors whose episodes it shows: names or radii in metres."""

    def make(self, material: Material) -> Drawing:
        """Measure, draw and describe."""
        shown = self.measure(material)
        return Drawing(figure=self.draw(shown), caption=self.caption(shown))
