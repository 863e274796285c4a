"""Recorded demonstrations: learn from all but one, score the one."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.report import Table, Target, number
from experiments.benchmarks.scores import Score, score
from experiments.datasets.npz import load_demonstrations
from gplfd_env.se3 import relative_poses
from policies.aligned import AlignedDemonstrations
from policies.alignment import align
from policies.demonstrations import Demonstration
from policies.skill import fit_skill

__all__ = ["RecordedScores", "load_recordings", "score_recordings"]

Array = NDArray[np.float64]

UNITS: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres in a unit of length."""
_SAMPLES = 200


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedRow:
    """One way to bring the recordings onto a clock."""

    clock: str
    """Which way."""
    score: Score
    """Mean over all demonstrations, each left out once; numbers in m and rad."""
    worst_nlpd: float
    """NLPD of the demonstration that was predicted worst."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedScores:
    """Every demonstration left out once."""

    file: str
    """Where the demonstrations come from."""
    demonstrations: int
    """How many there are."""
    rows: tuple[RecordedRow, ...]
    """One per clock."""

    def tables(self) -> tuple[Table, ...]:
        """One line per clock."""
        return (
            Table(
                title=f"recorded: {self.demonstrations} demonstrations of {self.file}, "
                "each left out once; numbers in m and rad",
                columns=(
                    *("", "NLPD", "worst NLPD"),
                    *("within 1.96 std", "in stated 95 %"),
                ),
                rows=tuple(
                    (
                        row.clock,
                        number(row.score.nlpd),
                        number(row.worst_nlpd),
                        number(row.score.coverage),
                        number(row.score.interval_coverage),
                    )
                    for row in self.rows
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Density and coverage on the first clock."""
        known = self.rows[0].score
        stated = known.interval_coverage
        coverage = known.coverage if stated is None else stated
        return (
            Target(name="recorded: NLPD per number", value=known.nlpd, high=-2.0),
            Target(name="recorded: stated 95 % holds", value=coverage, low=0.92),
        )


def load_recordings(
    path: Path,
    unit: Literal["m", "cm", "mm"] = "m",
    order: Literal["wxyz", "xyzw"] = "wxyz",
) -> tuple[Demonstration, ...]:
    """Read demonstrations from an .npz file of this project or an .npy array.

    An array has shape (D, N, 7), position and quaternion, at equal steps of time. Its
    poses become relative to the first of the first demonstration, so that all share
    one frame and stay far from where rotation vectors are singular.

    Args:
        path: File to read.
        unit: Unit of the array's positions.
        order: Where the array's quaternions have their scalar part.

    Raises:
        ValueError: The file holds something else, or fewer than three demonstrations.
        OSError: The file cannot be read.
    """
    if path.suffix == ".npz":
        found = load_demonstrations(path).demonstrations
    else:
        found = _from_array(path, unit, order)
    if len(found) < 3:
        raise ValueError(
            f"{path} holds {len(found)} demonstration(s); leaving one out needs 3 "
            "or more"
        )
    return found


def _from_array(
    path: Path, unit: Literal["m", "cm", "mm"], order: Literal["wxyz", "xyzw"]
) -> tuple[Demonstration, ...]:
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ValueError(
            f"{path} is neither demonstrations of this project (.npz) nor an array "
            "(.npy)"
        ) from error
    shape = getattr(array, "shape", None)
    if shape is None or len(shape) != 3 or shape[2] != 7:
        raise ValueError(
            f"{path} must hold an array of shape (demonstrations, samples, 7), "
            f"positions and quaternions, got {shape}"
        )
    clock = np.linspace(0.0, 1.0, shape[1])
    recorded = [
        Demonstration.from_quaternions(
            clock, UNITS[unit] * one[:, :3], one[:, 3:], order=order
        )
        for one in np.asarray(array, dtype=np.float64)
    ]
    origin = recorded[0].poses[0]
    return tuple(
        Demonstration(times=clock, poses=relative_poses(demo.poses, origin))
        for demo in recorded
    )


def score_recordings(
    demonstrations: Sequence[Demonstration], file: str
) -> RecordedScores:
    """Leave every demonstration out once, aligned and on the clock as recorded.

    The alignment sees the left-out demonstration: which of its samples belongs to
    which phase is not what is predicted.

    Args:
        demonstrations: Three or more.
        file: Where they come from, for the report.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        clocks = {
            "aligned by completion": align(demonstrations, n_samples=_SAMPLES),
            "clock as recorded": _on_own_clock(demonstrations),
        }
        rows = tuple(_row(name, aligned) for name, aligned in clocks.items())
    return RecordedScores(file=file, demonstrations=len(demonstrations), rows=rows)


def _on_own_clock(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    phases = np.linspace(0.0, 1.0, _SAMPLES)
    poses = []
    for demo in demonstrations:
        clock = (demo.times - demo.times[0]) / (demo.times[-1] - demo.times[0])
        columns = [np.interp(phases, clock, column) for column in demo.poses.T]
        poses.append(np.column_stack(columns))
    return AlignedDemonstrations(times=phases, poses=np.stack(poses))


def _row(clock: str, aligned: AlignedDemonstrations) -> RecordedRow:
    scores = []
    for left_out in range(len(aligned.poses)):
        given = np.delete(aligned.poses, left_out, axis=0)
        skill = fit_skill(AlignedDemonstrations(times=aligned.times, poses=given))
        predicted = skill.predict(aligned.times)
        scores.append(
            score(
                aligned.poses[left_out],
                predicted.mean,
                predicted.std,
                predicted.interval(0.95),
            )
        )
    return RecordedRow(
        clock=clock,
        score=Score.mean_of(scores),
        worst_nlpd=max(one.nlpd for one in scores),
    )
