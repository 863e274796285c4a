"""Links to the recordings that a study has kept."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from experiments.report.document import Block, Paragraph, Section, Table

FOLDER, INDEX = "recordings", "index.json"
COMPARISONS: Final = ("comparison.rrd", "comparison-widest.rrd")
"""Policies side by side at the middle and at the widest demonstrated door."""
RANKS: Final = ("best", "median", "worst")
"""Episodes of each policy that are recorded, by success, radial force and angle."""


def recording_section(study: Path, page: Path, policies: list[str]) -> Section:
    """List the recordings there are, with links relative to the page's folder."""
    folder = study / FOLDER
    prefix = Path(os.path.relpath(folder, page)).as_posix()
    index = _index(folder / INDEX)
    blocks: list[Block] = []
    there = [file for file in COMPARISONS if (folder / file).is_file()]
    if there:
        links = ", ".join(f"[{file}]({_address(prefix, file)})" for file in there)
        text = f"Several policies at the same door, side by side: {links}."
        blocks.append(Paragraph(text=text))
    rows = []
    for policy in policies:
        cells = [_cell(folder, prefix, policy, rank, index) for rank in RANKS]
        if any(cell != "–" for cell in cells):
            rows.append((f"`{policy}`", *cells))
    if rows:
        blocks.append(
            Table(
                columns=("policy", *RANKS),
                rows=tuple(rows),
                note="Ordered by success, then peak radial force, then final angle. "
                "Open one with `gplfd view FILE`.",
                left=True,
            )
        )
    if not blocks:
        blocks.append(
            Paragraph(text="None here; `gplfd benchmark --record` makes them.")
        )
    return Section(title="Recordings", anchor="recordings", blocks=tuple(blocks))


def _cell(
    folder: Path,
    prefix: str,
    policy: str,
    rank: str,
    index: Mapping[str, Mapping[str, Any]],
) -> str:
    file = f"{policy}-{rank}.rrd"
    if not (folder / file).is_file():
        return "–"
    entry = index.get(file, {})
    text = f"[{file}]({_address(prefix, file)})"
    if "door" in entry:
        text += f" {entry['door']}, seed {entry['seed']}"
    if entry.get("repeated") is False:
        names = ", ".join(entry.get("different", ())).replace("_", " ")
        text += f" (**differs from the stored result:** {names})"
    return text


def _address(prefix: str, file: str) -> str:
    return quote(f"{prefix}/{file}")


def _index(path: Path) -> Mapping[str, Mapping[str, Any]]:
    """Entries of the index by file; empty without one that can be read."""
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["episodes"]
        return {str(entry["file"]): entry for entry in entries if entry.get("file")}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
