"""Motion files made into a set of demonstrations, in a folder."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.preparation import Motion, Preparation, prepare
from gplfd_experiments.data.preparation.report import draw, report
from gplfd_experiments.data.raw import RawRecording, Selection
from gplfd_experiments.data.readers import read_recordings
from gplfd_experiments.files.folders import check_replaceable, complete_folder
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_policies.demonstrations.npz import (
    FILE,
    FIRST_POSE,
    FRAME,
    OTHER,
    save_demonstrations,
)

PICTURE: Final = "before_after.png"


def import_recordings(
    files: Sequence[Path],
    folder: Path,
    *,
    selection: Selection,
    preparation: Preparation,
    options: Mapping[str, Any],
    overwrite: bool = False,
) -> tuple[tuple[Motion, ...], str]:
    """Read motion files, prepare the motions, and write a complete set or nothing.

    The set holds the demonstrations (`gplfd_policies.demonstrations.npz`), the report,
    a picture of before and after, and where everything came from, with the options of
    the command.

    Returns:
        The motions in the set, and the report.

    Raises:
        ValueError: An argument is wrong, or a file cannot be understood or used.
        OSError: A file cannot be read, or the set not be written.
    """
    check_folder(folder.parent)
    check_replaceable(folder, FILE, "set of demonstrations", overwrite=overwrite)
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
    frames = {"hinge": FRAME, "first-pose": FIRST_POSE}
    with complete_folder(folder) as written:
        written.mkdir()
        save_demonstrations(
            written / FILE,
            [motion.demonstration for motion in motions],
            [motion.radius for motion in motions],
            frame=frames.get(str(preparation.frame), OTHER),
            signals=[motion.signals for motion in motions],
        )
        (written / "report.txt").write_text(text + "\n", encoding="utf-8")
        write_json(written / "import.json", origin)
        draw(motions, written / PICTURE)
    return motions, text
