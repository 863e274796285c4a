"""Captions of a folder of figures, in one Markdown file."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from gplfd_policies.arrays.storage import complete_or_absent

FILE: Final = "captions.md"


def section(name: str, title: str, seed: int, caption: str) -> str:
    """One figure's section: heading, and the caption as one paragraph."""
    return f"## {name}: {title} (seed {seed})\n\n{caption}\n"


def update_captions(
    folder: Path, sections: Mapping[str, str], order: Sequence[str]
) -> None:
    """Write sections to the folder's captions, keeping those of other figures.

    Args:
        folder: Where the figures are.
        sections: Sections by the figure's name; they replace older ones.
        order: Names in the order of the file; a section of any other name is dropped.

    Raises:
        OSError: The file cannot be read or written.
    """
    path = folder / FILE
    there = path.read_text(encoding="utf-8") if path.is_file() else ""
    _, *parts = re.split(r"^(?=## (\S+): )", there, flags=re.MULTILINE)
    kept = {
        name: old.rstrip("\n") + "\n"
        for name, old in zip(parts[::2], parts[1::2], strict=True)
    }
    kept.update(sections)
    text = "\n".join(kept[name] for name in order if name in kept)
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
