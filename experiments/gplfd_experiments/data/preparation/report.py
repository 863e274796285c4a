"""What was done to recordings, and what should be looked at, as text."""

from collections.abc import Sequence

import numpy as np

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.data.preparation import Motion
from gplfd_experiments.data.preparation.settings import Preparation
from gplfd_experiments.files.table import Table, text_table

_COLUMNS = (
    "",
    "from",
    "recorded [s]",
    "rate [Hz]",
    "kept [s]",
    "samples",
    "path [m]",
    "turned [deg]",
    "peak force [N]",
)


def report(motions: Sequence[Motion], settings: Preparation) -> str:
    """Return the settings in words, a row per motion, and every note."""
    force = any("force" in motion.signals for motion in motions)
    columns = _COLUMNS if force else _COLUMNS[:-1]
    rows = [_row(n, motion)[: len(columns)] for n, motion in enumerate(motions)]
    notes = [
        f"{'!' if note.warning else ' '} {number}: {note.text}"
        for number, motion in enumerate(motions)
        for note in motion.notes
    ]
    table = Table(columns=columns, rows=tuple(rows))
    return "\n".join([_in_words(settings), "", text_table(table), "", *notes]).rstrip()


def warnings_in(motions: Sequence[Motion]) -> int:
    """Return how many notes a person should look at."""
    return sum(note.warning for motion in motions for note in motion.notes)


def _row(number: int, motion: Motion) -> tuple[str, ...]:
    times, poses = motion.demonstration.times, motion.demonstration.poses
    recorded = motion.recorded
    path = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).sum()
    turned = rotation_distance(poses[:, 3:], poses[0, 3:]).max()
    force = motion.signals.get("force")
    peak = "" if force is None else f"{np.linalg.norm(force[:, :3], axis=1).max():.1f}"
    return (
        str(number),
        motion.name,
        f"{recorded.times[-1] - recorded.times[0]:.2f}",
        f"{1.0 / recorded.step:.4g}",
        f"{times[-1] - times[0]:.2f}",
        str(len(times)),
        f"{path:.3f}",
        f"{np.degrees(turned):.1f}",
        peak,
    )


def _in_words(settings: Preparation) -> str:
    """Return what was done to all of them."""
    frame = settings.frame
    parts = [
        f"frame: {frame if isinstance(frame, str) else 'relative to a given pose'}",
        "not filtered"
        if settings.cutoff is None
        else f"low-pass filter of {settings.cutoff:g} Hz",
        "rests at the ends cut" if settings.trim_rests else "rests kept",
        "samples as recorded"
        if settings.rate is None
        else f"{settings.rate:g} samples per second",
    ]
    if settings.offset is not None:
        parts.append("moved by the offset of the hand")
    return "; ".join(parts)
