"""Fig. 3, Section III-C: time distortion, and alignment by two similarity measures."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.analysis.figures.pick_and_place import (
    HEIGHT,
    ShelfMotion,
    shelf_motions,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies import AlignedDemonstrations, align
from gplfd_policies.demonstrations.alignment import (
    AlignmentMethod,
    task_completion_index,
)

TITLE: Final = "Alignment by distance and by task completion"
DOORS: Final = ()
LEVELS: Final = (0.12, 0.45)
_COLOURS: Final = {LEVELS[0]: style.DOORS[0], LEVELS[1]: style.DOORS[2]}
_PER_LEVEL: Final = 3
CLOCK, EUCLIDEAN, COMPLETION, PUBLISHED = "clock", "euclidean", "completion", "dtw"
_METHODS: Final[Mapping[str, AlignmentMethod]] = {
    EUCLIDEAN: "dtw-euclidean",
    COMPLETION: "interpolation",
    PUBLISHED: "dtw",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Alignments:
    """Data of Fig. 3."""

    motions: tuple[ShelfMotion, ...]
    completion: tuple[FloatArray, ...]
    """Task completion index of each motion, (N,)."""
    aligned: Mapping[str, AlignedDemonstrations]
    phase_error: Mapping[str, float]
    """Difference of true progress between aligned samples, rms over phases and motions,
    by alignment; "clock" is without alignment."""
    end_error: Mapping[str, float]
    """Largest distance of an aligned end from the recorded end [m]."""


def measure(material: Material) -> Alignments:
    """Align one set of motions in each way."""
    motions = shelf_motions(LEVELS, _PER_LEVEL, np.random.default_rng(material.seed))
    demonstrations = [motion.demonstration for motion in motions]
    # As recorded: rests of the hand at a shelf are kept.
    aligned = {
        name: align(demonstrations, method=method, trim_rests=False)
        for name, method in _METHODS.items()
    }
    phases = np.linspace(0.0, 1.0, 200)
    # Motions scaled to the same duration, not aligned.
    clocks = [motion.demonstration.times for motion in motions]
    progress = {
        CLOCK: [
            np.interp(phases, times / times[-1], motion.progress)
            for times, motion in zip(clocks, motions, strict=True)
        ]
    }
    end_error = {}
    for name, motions_aligned in aligned.items():
        progress[name], ends = [], []
        for motion, poses in zip(motions, motions_aligned.poses, strict=True):
            # An aligned pose has the progress of the nearest recorded pose, because the
            # motions do not cross themselves.
            recorded = motion.demonstration.poses[:, :3]
            distance = np.linalg.norm(poses[:, None, :3] - recorded, axis=2)
            progress[name].append(motion.progress[distance.argmin(axis=1)])
            ends += [poses[end, :3] - recorded[end] for end in (0, -1)]
        end_error[name] = max(float(np.linalg.norm(offset)) for offset in ends)
    return Alignments(
        motions=motions,
        completion=tuple(map(task_completion_index, demonstrations)),
        aligned=aligned,
        phase_error={
            name: float(np.sqrt(np.var(values, axis=0).mean()))
            for name, values in progress.items()
        },
        end_error=end_error,
    )


def draw(shown: Alignments) -> Figure:
    """Draw heights against time and against the phases of two alignments, and ζ."""
    figure = style.new_figure(style.COLUMN, 3.4)
    (recorded, euclidean), (completed, index) = figure.subplots(2, 2)
    for motion, completion in zip(shown.motions, shown.completion, strict=True):
        colour, times = _COLOURS[motion.level], motion.demonstration.times
        recorded.plot(times, motion.demonstration.poses[:, HEIGHT], color=colour)
        index.plot(times, completion, color=colour)
    for panel, name in ((euclidean, EUCLIDEAN), (completed, COMPLETION)):
        aligned = shown.aligned[name]
        for motion, poses in zip(shown.motions, aligned.poses, strict=True):
            colour = _COLOURS[motion.level]
            panel.plot(aligned.times, poses[:, HEIGHT], color=colour)
        panel.set(xlabel="phase", xlim=(0.0, 1.0), xticks=[0.0, 0.5, 1.0])
        error = f"phase error {100.0 * shown.phase_error[name]:.1f} %"
        style.note(panel, 0.05, error, fontsize=6.5)
    for panel in (recorded, index):
        panel.set(xlabel="time [s]", xlim=(0.0, None))
    for panel in (recorded, euclidean, completed):
        panel.set(ylabel="height [m]", ylim=(-0.03, 0.52))
    index.set_ylabel("completion ζ")
    shelves = {"high shelf": recorded.lines[-1], "low shelf": recorded.lines[0]}
    style.legend_above(figure, shelves)
    titles = "as recorded", "Euclidean DTW", "completion index", "the index itself"
    style.name_panels(figure.axes, titles)
    return figure


def caption(shown: Alignments) -> str:
    """Describe the figure and state its numbers."""
    error = {name: 100.0 * value for name, value in shown.phase_error.items()}
    step = {
        name: 1e3 * np.abs(np.diff(aligned.poses[:, :, :3], 2, axis=1)).max()
        for name, aligned in shown.aligned.items()
    }
    return (
        f"{len(shown.motions)} synthetic pick-and-place motions to shelves at "
        f"{LEVELS[0]:.2f} m and {LEVELS[1]:.2f} m. (a) As recorded. (b) Dynamic time "
        "warping on the distance of poses: the low motions arrive early and wait. (c) "
        "Matched at equal task completion index, Eq. (16), both arrive together. (d) "
        "The index. Unlike in the paper, (c) interpolates the index; warping on it has "
        f"steps (largest second difference {step[PUBLISHED]:.1f} mm against "
        f"{step[COMPLETION]:.1f} mm). Rms difference of true progress at equal phase: "
        f"{error[CLOCK]:.1f} % when only scaled to one duration, "
        f"{error[EUCLIDEAN]:.1f} % in (b), {error[COMPLETION]:.1f} % in (c), "
        f"{error[PUBLISHED]:.1f} % for warping on the index. Recorded ends are kept "
        f"within {1e3 * shown.end_error[COMPLETION]:.2f} mm in (c) and "
        f"{1e3 * shown.end_error[EUCLIDEAN]:.1f} mm in (b)."
    )
