"""Makes a set of demonstrations from motion files, with a report and a picture."""

from collections.abc import Sequence
from dataclasses import asdict
from glob import glob
from pathlib import Path
from typing import Final

import numpy as np

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.preparation import PreparedMotion, prepare
from gplfd_experiments.data.readers import read_files
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.folders import check_replaceable, complete_folder
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.files.table import Table, text_table
from gplfd_policies.demonstrations import npz
from gplfd_policies.demonstrations.demonstration import turned

PICTURE: Final = "before_after.png"
_TITLES: Final = (
    ("recorded: position [m]", "prepared: position [m]"),
    ("recorded: quaternion", "prepared: rotation vector [rad]"),
    ("recorded: force [N]", "prepared: force [N]"),
)


def import_recordings(
    files: Sequence[Path],
    folder: Path,
    settings: ImportSettings,
    *,
    overwrite: bool = False,
) -> tuple[tuple[PreparedMotion, ...], str]:
    """Read motion files, prepare the motions, and write a complete set or nothing.

    The set holds the demonstrations (`gplfd_policies.demonstrations.npz`), the report,
    a picture of the motions before and after, and their origin with the settings.
    Returns the motions and the report. Raises ValueError for a file that cannot be
    understood or used, OSError for one that cannot be read or written.
    """
    # Wildcards that the shell left alone.
    matching = {f: [] if f.exists() else sorted(map(Path, glob(str(f)))) for f in files}
    files = [path for file in files for path in matching[file] or [file]]
    check_folder(folder.parent)
    check_replaceable(folder, "import.json", "imported set", overwrite=overwrite)
    reading = progress_bar(
        read_files(files, settings), desc="reading", unit="file", total=len(files)
    )
    motions = prepare([raw for recordings in reading for raw in recordings], settings)
    text = report(motions, settings)
    urdf = settings.urdf.name if settings.urdf else None
    origin = provenance(asdict(settings) | {"urdf": urdf})
    origin["files"] = [
        {"name": file.name} | ({"sha256": content_hash(file)} if file.is_file() else {})
        for file in files
    ]
    frames = {"hinge": npz.FRAME, "first-pose": npz.FIRST_POSE}
    with complete_folder(folder, replace=overwrite) as written:
        written.mkdir()
        npz.save_demonstrations(
            written / npz.FILE,
            [motion.demonstration for motion in motions],
            [motion.radius for motion in motions],
            frame=frames.get(str(settings.frame), npz.OTHER),
            signals=[motion.signals for motion in motions],
        )
        (written / "report.txt").write_text(text + "\n", encoding="utf-8")
        write_json(written / "import.json", origin)
        draw(motions, written / PICTURE)
    return motions, text


def report(
    motions: Sequence[PreparedMotion],
    settings: ImportSettings,
    columns: int | None = None,
) -> str:
    """Return the settings, a row of some columns or of all per motion, and notes."""
    frame, cutoff, rate = settings.frame, settings.cutoff, settings.rate
    done = [
        f"frame: {frame if isinstance(frame, str) else 'relative to a given pose'}",
        f"low-pass filter of {cutoff:g} Hz" if cutoff else "not filtered",
        "rests kept" if settings.keep_rests else "rests at the ends cut",
        f"{rate:g} samples per second" if rate else "samples as recorded",
    ]
    if settings.offset is not None:
        done.append("moved by the offset of the hand")
    forces = any(motion.demonstration.wrenches is not None for motion in motions)
    rows, notes = [], []
    for number, motion in enumerate(motions):
        times, poses = motion.demonstration.times, motion.demonstration.poses
        before = motion.recorded
        path = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).sum()
        row = {
            "": str(number),
            "from": motion.name,
            "kept [s]": f"{times[-1] - times[0]:.2f}",
            "path [m]": f"{path:.3f}",
            "turned [deg]": f"{turned(motion.demonstration):.1f}",
            "recorded [s]": f"{before.times[-1] - before.times[0]:.2f}",
            "rate [Hz]": f"{1.0 / before.step:.4g}",
            "samples": str(len(times)),
        }
        if forces:
            row["peak force [N]"] = ""
            if (wrenches := motion.demonstration.wrenches) is not None:
                peak = np.linalg.norm(wrenches[:, :3], axis=1).max()
                row["peak force [N]"] = f"{peak:.1f}"
        rows.append(row)
        for note in motion.notes:
            notes.append(f"{'!' if note.warning else ' '} {number}: {note.text}")
    table = text_table(Table.of(rows), columns)
    return "\n".join(["; ".join(done), "", table, "", *notes]).rstrip()


def draw(motions: Sequence[PreparedMotion], path: Path) -> None:
    """Write a picture: recorded motions on the left, prepared ones on the right."""
    from matplotlib.figure import Figure

    forces = any(motion.demonstration.wrenches is not None for motion in motions)
    rows = 3 if forces else 2
    figure = Figure(figsize=(11.0, 3.25 * rows), layout="constrained")
    for (row, column), axes in np.ndenumerate(figure.subplots(rows, 2)):
        names = ("w", "x", "y", "z") if (row, column) == (1, 0) else ("x", "y", "z")
        for number, motion in enumerate(motions):
            drawn = motion.demonstration if column else motion.recorded
            values = (drawn.poses[:, :3], drawn.poses[:, 3:], drawn.wrenches)[row]
            if values is None:
                continue
            clock = drawn.times - drawn.times[0]
            for place, component in enumerate(values.T[: len(names)]):
                axes.plot(clock, component, color=f"C{place}", linewidth=0.8, alpha=0.7)
                # The number that the report gives it.
                end = clock[-1], component[-1]
                axes.annotate(str(number), end, fontsize=6, color=f"C{place}")
        axes.set_title(_TITLES[row][column], loc="left", fontsize=10)
        axes.legend(axes.lines[: len(names)], names)
        axes.grid(alpha=0.3)
        if row:
            axes.set_xlabel("time since the first sample [s]")
    figure.savefig(path, dpi=110)
