"""Makes a set of demonstrations from motion files, with a report and a picture."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.preparation import Motion, Preparation, prepare
from gplfd_experiments.data.raw import RawRecording, Selection
from gplfd_experiments.data.readers import read_files
from gplfd_experiments.files.folders import check_replaceable, complete_folder
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.files.table import Table, text_table
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
    a picture of the motions before and after, and their origin, with the options of the
    command.

    Returns:
        The motions in the set, and the report.

    Raises:
        ValueError: An argument is wrong, or a file cannot be understood or used.
        OSError: A file cannot be read, or the set not be written.
    """
    check_folder(folder.parent)
    check_replaceable(folder, FILE, "set of demonstrations", overwrite=overwrite)
    recordings: list[RawRecording] = []
    for motions_of_file in progress_bar(
        read_files(files, selection), desc="reading", unit="file", total=len(files)
    ):
        recordings += motions_of_file
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


def report(motions: Sequence[Motion], settings: Preparation) -> str:
    """Return the settings as text, a row per motion, and every note."""
    frame, cutoff, rate = settings.frame, settings.cutoff, settings.rate
    done = [
        f"frame: {frame if isinstance(frame, str) else 'relative to a given pose'}",
        "not filtered" if cutoff is None else f"low-pass filter of {cutoff:g} Hz",
        "rests at the ends cut" if settings.trim_rests else "rests kept",
        "samples as recorded" if rate is None else f"{rate:g} samples per second",
    ]
    if settings.offset is not None:
        done.append("moved by the offset of the hand")
    forces = any(motion.demonstration.wrenches is not None for motion in motions)
    rows = []
    for number, motion in enumerate(motions):
        times, poses = motion.demonstration.times, motion.demonstration.poses
        before = motion.recorded
        path = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).sum()
        turned = rotation_distance(poses[:, 3:], poses[0, 3:]).max()
        row = {
            "": str(number),
            "from": motion.name,
            "recorded [s]": f"{before.times[-1] - before.times[0]:.2f}",
            "rate [Hz]": f"{1.0 / before.step:.4g}",
            "kept [s]": f"{times[-1] - times[0]:.2f}",
            "samples": str(len(times)),
            "path [m]": f"{path:.3f}",
            "turned [deg]": f"{np.degrees(turned):.1f}",
        }
        if forces:
            row["peak force [N]"] = ""
            if (wrenches := motion.demonstration.wrenches) is not None:
                peak = np.linalg.norm(wrenches[:, :3], axis=1).max()
                row["peak force [N]"] = f"{peak:.1f}"
        rows.append(row)
    notes = [
        f"{'!' if note.warning else ' '} {number}: {note.text}"
        for number, motion in enumerate(motions)
        for note in motion.notes
    ]
    return "\n".join(
        ["; ".join(done), "", text_table(Table.of(rows)), "", *notes]
    ).rstrip()


def warnings_in(motions: Sequence[Motion]) -> int:
    """Return the number of notes that need attention."""
    return sum(note.warning for motion in motions for note in motion.notes)


def draw(motions: Sequence[Motion], path: Path) -> None:
    """Write a picture: recorded motions on the left, prepared ones on the right.

    Positions are in the upper row, orientations below: the components of the recorded
    quaternions, and of the resulting rotation vectors. If a motion has forces, a third
    row shows those of the hand on what it holds, in the axes of the recorded and of the
    prepared poses.
    """
    from matplotlib.figure import Figure

    number = 2 + any(motion.demonstration.wrenches is not None for motion in motions)
    figure = Figure(figsize=(11.0, 3.25 * number), layout="constrained")
    axes = figure.subplots(number, 2)
    xyz = ("x", "y", "z")
    panels: tuple[tuple[int, int, str, tuple[str, ...]], ...] = (
        (0, 0, "recorded: position [m]", xyz),
        (0, 1, "prepared: position [m]", xyz),
        (1, 0, "recorded: quaternion", ("w", *xyz)),
        (1, 1, "prepared: rotation vector [rad]", xyz),
        (2, 0, "recorded: force [N]", xyz),
        (2, 1, "prepared: force [N]", xyz),
    )
    for row, column, what, names in panels[: 2 * number]:
        one = axes[row, column]
        for motion in motions:
            drawn = motion.demonstration if column else motion.recorded
            clock = drawn.times - drawn.times[0]
            values = (drawn.poses[:, :3], drawn.poses[:, 3:], drawn.wrenches)[row]
            if values is None:
                continue
            for place, component in enumerate(values.T[: len(names)]):
                one.plot(clock, component, color=f"C{place}", linewidth=0.8, alpha=0.7)
        one.set_title(what, loc="left", fontsize=10)
        one.legend(one.lines[: len(names)], names)
        one.grid(alpha=0.3)
        if row:
            one.set_xlabel("time since the first sample [s]")
    figure.savefig(path, dpi=110)
