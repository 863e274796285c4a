"""Input of the figures, and the record of a figure."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from matplotlib.figure import Figure

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

POLICY: Final = "gp"
"""Policy whose episodes figures show; other policies get the same observations."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Episodes by door, the demonstrations of their policy, and the common seed."""

    seed: int
    demonstrations: LabelledDemonstrations
    episodes: Mapping[str, EpisodeLog]


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure of the paper, or one more; nothing is simulated."""

    title: str
    draw: Callable[[Material], tuple[Figure, str]]
    """Returns the figure, and a paragraph about it, the paper's version and the
    numbers."""
    doors: tuple[str, ...] = ()
    """Doors whose episodes it shows."""
