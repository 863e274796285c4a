"""The content of a report, which `writing` writes as HTML and as Markdown.

Texts may hold ``**bold**``, ```code```, ``[links](address)`` and backslashes before
characters that are none of these marks; everything else is shown as it stands. What
comes from a file goes through `code` or `literal`.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from matplotlib.figure import Figure

from gplfd_experiments.files.table import Table


@dataclass(frozen=True, kw_only=True, slots=True)
class Paragraph:
    """Running text, a few sentences."""

    text: str
    """Its sentences, with marks."""
    warning: bool = False
    """Whether a reader must not miss it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Items:
    """A list of short texts; empty ones are left out."""

    texts: tuple[str, ...]
    """A text with marks per item."""

    def __post_init__(self) -> None:
        """Leave out what says nothing."""
        object.__setattr__(self, "texts", tuple(filter(None, self.texts)))


@dataclass(frozen=True, kw_only=True, slots=True)
class Verbatim:
    """Text as it was written elsewhere: commands, error messages."""

    text: str
    """Lines, without marks."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Picture:
    """A plot, drawn when the page is written."""

    name: str
    """Of its files, without suffix."""
    draw: Callable[[], Figure]
    """Makes it, inside `gplfd_experiments.analysis.figures.style.paper_style`."""
    caption: str
    """What is seen, in a sentence or two."""
    alternative: str
    """What it shows, for those who cannot see it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Details:
    """A table that HTML folds away."""

    title: str
    """What it shows, without marks."""
    table: Table
    """What is folded."""


Block = Paragraph | Items | Verbatim | Table | Picture | Details


@dataclass(frozen=True, kw_only=True, slots=True)
class Section:
    """Blocks under a heading."""

    title: str
    """Its heading, with marks."""
    anchor: str
    """Its address in the page: lower-case letters, digits and hyphens."""
    blocks: tuple[Block, ...]
    """What stands under it, in order."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Document:
    """A whole page, before it is written."""

    title: str
    """Its first heading, without marks."""
    lead: tuple[Block, ...]
    """What comes before the first section."""
    sections: tuple[Section, ...]
    """What follows, in order."""

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All plots of the sections, in order."""
        return tuple(
            block
            for section in self.sections
            for block in section.blocks
            if isinstance(block, Picture)
        )


def code(text: object) -> str:
    """Return a name or another text of a file, to be shown as code."""
    return f"`{' '.join(str(text).split()).replace('`', chr(39))}`"


def literal(text: object) -> str:
    """Return a text of a file, to be shown as it stands."""
    return re.sub(r"([\\`*\[\]])", r"\\\1", " ".join(str(text).split()))


def names(policies: Iterable[str]) -> str:
    """List policies in a sentence."""
    return ", ".join(map(code, policies))
