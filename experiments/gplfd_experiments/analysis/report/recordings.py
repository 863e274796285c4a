"""Recordings of a study: names, index and links."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from gplfd_experiments.analysis.report.document import Section, code, literal
from gplfd_experiments.files.names import file_name
from gplfd_experiments.files.plain_data import entry, read_json
from gplfd_experiments.files.table import Table

FOLDER, INDEX = "recordings", "index.json"
COMPARISONS: Final = ("comparison.rrd", "comparison-widest.rrd")
"""Files with policies side by side at the middle and the widest demonstrated door."""
RANKS: Final = ("best", "median", "worst")
"""Recorded episodes of each policy, by success, radial force and angle."""

_ENTRIES: Final[Any] = tuple[dict[str, Any], ...]


def recording_name(policy: str, rank: str) -> str:
    """Return a valid file name of a recording for any policy name."""
    return f"{file_name(policy)}-{rank}.rrd"


def trial_recording_name(trial: str) -> str:
    """Return the file name of a trial's comparison."""
    return f"trial-{file_name(trial)}.rrd"


def link_trial(section: Section, study: Path, page: Path, trial: str) -> None:
    """Link a trial's comparison, if there is one, with its description."""
    file = trial_recording_name(trial)
    if (link := _links(study, page).get(file)) is None:
        return
    try:
        comparisons = entry(read_json(study / FOLDER / INDEX), "comparisons", _ENTRIES)
        named = [one for one in comparisons if one.get("file") == file]
        if not named:
            raise ValueError(f"{INDEX} does not name {file}")
        shown = entry(named[0], "episodes", _ENTRIES)
        said = [(code(entry(each, "policy", str)), _about(each)) for each in shown]
        alike = len({about for _, about in said}) == 1
        about = said[0][1] if alike else "; ".join(map(" ".join, said))
    except (OSError, ValueError) as error:
        about = f"its description cannot be read: {literal(error)}"
    section.say(f"Side by side: {link}, {about}.")


def recording_section(study: Path, page: Path, policies: Iterable[str]) -> Section:
    """List the recordings of a study, with links relative to the page's folder."""
    section = Section("Recordings", "recordings")
    links = _links(study, page)
    if there := [links[file] for file in COMPARISONS if file in links]:
        section.say(
            f"Several policies at the same door, side by side: {', '.join(there)}."
        )
    index: dict[str, str] = {}
    try:
        entries = entry(read_json(study / FOLDER / INDEX), "episodes", _ENTRIES)
        index = {entry(one, "file", str): _about(one) for one in entries}
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:
        text = f"The descriptions of the recordings cannot be read: {literal(error)}"
        section.say(text, warning=True)
    rows = []
    for policy in policies:
        files = [recording_name(policy, rank) for rank in RANKS]
        cells = [f"{links.get(f, '')} {index.get(f, '')}".strip() for f in files]
        if any(cells):
            rows.append((code(policy), *(cell or "–" for cell in cells)))
    if rows:
        note = (
            "Ordered by success, then peak radial force, then final angle. Open one "
            "with `gplfd view FILE`."
        )
        columns = ("policy", *RANKS)
        section.table(Table(columns=columns, rows=tuple(rows), note=note, left=True))
    if not section.blocks:
        section.say(
            "Those of trials are linked in their sections."
            if links
            else "None here; `--record` makes them."
        )
    return section


def _links(study: Path, page: Path) -> dict[str, str]:
    """Links to a study's recordings, relative to the page's folder, by file name."""
    folder = study / FOLDER
    prefix = Path(os.path.relpath(folder, page)).as_posix()
    return {
        path.name: f"[{literal(path.name)}]({quote(f'{prefix}/{path.name}')})"
        for path in folder.glob("*.rrd")
    }


def _about(one: Mapping[str, Any]) -> str:
    text = f"{literal(entry(one, 'door', str))}, seed {entry(one, 'seed', int)}"
    if "error" in one:
        return f"{text} (**not repeated:** {code(entry(one, 'error', str))})"
    if not entry(one, "repeated", bool):
        metrics = ", ".join(entry(one, "different", dict[str, Any])).replace("_", " ")
        return f"{text} (**differs from the stored result:** {literal(metrics)})"
    return text
