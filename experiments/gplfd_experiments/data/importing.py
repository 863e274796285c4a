"""Motion files made into a set of demonstrations, in a folder."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.npz import (
    FILE,
    FIRST_POSE,
    FRAME,
    OTHER,
    save_demonstrations,
)
from gplfd_experiments.data.preparation import Motion, prepare
from gplfd_experiments.data.preparation.report import draw, report, warnings_in
from gplfd_experiments.data.preparation.settings import Preparation
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers import read_recordings
from gplfd_experiments.data.readers.selection import Selection
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import content_hash, provenance

REPORT: Final = "report.txt"
PICTURE: Final = "before_after.png"
ORIGIN: Final = "import.json"


@dataclass(frozen=True, kw_only=True, slots=True)
class Imported:
    """A set of demonstrations that was made."""

    folder: Path
    """Where it is."""
    motions: tuple[Motion, ...]
    """What is in it."""
    report: str
    """What was done."""
    warnings: int
    """How many notes of the report a person should look at."""


def import_recordings(
    files: Sequence[Path],
    folder: Path,
    *,
    selection: Selection,
    preparation: Preparation,
    options: Mapping[str, Any],
    overwrite: bool = False,
) -> Imported:
    """Read motion files, prepare the motions, and write a complete set or nothing.

    The set holds the demonstrations (`gplfd_experiments.data.npz`), the report, a
    picture of before and after, and where everything came from.

    Args:
        files: Files or folders, of any kinds that are read.
        folder: The set.
        selection: What to read of them.
        preparation: What to do to them.
        options: The command's, for the record; JSON-able.
        overwrite: Replace a set that is there already.

    Raises:
        ValueError: An argument is wrong, or a file cannot be understood or used.
        OSError: A file cannot be read, or the set not be written.
    """
    check_folder(folder.parent)
    if folder.exists():
        if not (folder / FILE).is_file():
            raise ValueError(
                f"--out {folder} exists and is no set of demonstrations; give another"
            )
        if not overwrite:
            raise ValueError(
                f"--out {folder} exists; give another, or --overwrite to replace it"
            )
    recordings: list[RawRecording] = []
    for file in progress_bar(files, desc="reading", unit="file"):
        recordings += read_recordings(file, selection)
    motions = prepare(recordings, preparation, recorded_rate=selection.recorded_rate)
    text = report(motions, preparation)
    origin = provenance({**options, "preparation": asdict(preparation)})
    origin["files"] = [
        {"name": file.name} | ({"sha256": content_hash(file)} if file.is_file() else {})
        for file in files
    ]
    with complete_folder(folder) as written:
        written.mkdir()
        save_demonstrations(
            written / FILE,
            [motion.demonstration for motion in motions],
            [motion.radius for motion in motions],
            frame={"hinge": FRAME, "first-pose": FIRST_POSE}.get(
                str(preparation.frame), OTHER
            ),
            signals=[motion.signals for motion in motions],
        )
        (written / REPORT).write_text(text + "\n", encoding="utf-8")
        write_json(written / ORIGIN, origin)
        draw(motions, written / PICTURE)
    return Imported(
        folder=folder, motions=motions, report=text, warnings=warnings_in(motions)
    )
