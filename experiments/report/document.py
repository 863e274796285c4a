"""A page as a value: what it says, apart from how HTML or Markdown writes it.

Texts may hold ``**bold**``, ```code``` and ``[links](address)``; everything else is
shown as it stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, slots=True)
class Paragraph:
    """Running text."""

    text: str
    """What it says."""
    warning: bool = False
    """Whether a reader must not miss it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Items:
    """A list of short texts."""

    texts: tuple[str, ...]
    """One per item."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Verbatim:
    """Text as it was written elsewhere: commands, error messages."""

    text: str
    """Lines."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Table:
    """Texts in rows; the first cell of each names the row."""

    columns: tuple[str, ...]
    """Heads with units."""
    rows: tuple[tuple[str, ...], ...]
    """Cells, as many as there are heads; what stands after a line break is small."""
    note: str = ""
    """What a reader has to know to read it."""
    left: bool = False
    """Whether all cells are text, flush left, rather than numbers."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Picture:
    """A plot."""

    name: str
    """Of its files, without suffix."""
    draw: Callable[[], Figure]
    """Makes it, inside `experiments.figures.style.paper_style`."""
    caption: str
    """What is seen."""
    alternative: str
    """What it shows, for those who cannot see it."""


Block = Paragraph | Items | Verbatim | Table | Picture


@dataclass(frozen=True, kw_only=True, slots=True)
class Section:
    """Blocks under a heading."""

    title: str
    """Heading."""
    anchor: str
    """Its address in the page: lower-case letters, digits and hyphens."""
    blocks: tuple[Block, ...]
    """What it says."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Document:
    """A page."""

    title: str
    """Its name."""
    lead: tuple[Block, ...]
    """What comes before the first section."""
    sections: tuple[Section, ...]
    """In order."""

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All plots of the sections, in order."""
        return tuple(
            block
            for section in self.sections
            for block in section.blocks
            if isinstance(block, Picture)
        )
