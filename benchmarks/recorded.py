"""Recorded demonstrations, each left out once: python benchmarks/recorded.py FILE."""

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
import tyro

from experiments.datasets.npz import load_demonstrations
from experiments.speed.align import resampled
from experiments.speed.report import Measurement, at_least, at_most, measure_all
from experiments.speed.scores import mean_scores, score
from gplfd_env.se3 import relative_poses
from policies.aligned import AlignedDemonstrations
from policies.alignment import align
from policies.demonstrations import Demonstration
from policies.skill import fit_skill

Unit = Literal["m", "cm", "mm"]
Order = Literal["wxyz", "xyzw"]

_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_SAMPLES: Final = 200


def load_recordings(
    path: Path, unit: Unit = "m", order: Order = "wxyz"
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


def _from_array(path: Path, unit: Unit, order: Order) -> tuple[Demonstration, ...]:
    array = np.load(path, allow_pickle=False)
    if array.ndim != 3 or array.shape[2] != 7:
        raise ValueError(
            f"{path} must hold an array of shape (demonstrations, samples, 7), "
            f"positions and quaternions, got {array.shape}"
        )
    clock = np.linspace(0.0, 1.0, array.shape[1])
    recorded = [
        Demonstration.from_quaternions(
            clock, _METRES[unit] * one[:, :3], one[:, 3:], order=order
        )
        for one in array.astype(np.float64)
    ]
    origin = recorded[0].poses[0]
    return tuple(
        Demonstration(times=clock, poses=relative_poses(demo.poses, origin))
        for demo in recorded
    )


def score_recordings(
    demonstrations: Sequence[Demonstration], file: Path
) -> Measurement:
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
        rows = {name: _left_out_once(aligned) for name, aligned in clocks.items()}
    first = rows["aligned by completion"]
    return Measurement(
        title=f"recorded: {len(demonstrations)} demonstrations of {file}, each left "
        "out once; numbers in m and rad",
        rows=rows,
        targets=(
            at_most("recorded: NLPD per number", first["NLPD"], -2.0),
            at_least("recorded: stated 95 % holds", first["in stated 95 %"], 0.92),
        ),
    )


def _on_own_clock(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    poses = [resampled(demo, _SAMPLES).poses for demo in demonstrations]
    phases = np.linspace(0.0, 1.0, _SAMPLES)
    return AlignedDemonstrations(times=phases, poses=np.stack(poses))


def _left_out_once(aligned: AlignedDemonstrations) -> dict[str, float]:
    scores = []
    for left_out, poses in enumerate(aligned.poses):
        given = np.delete(aligned.poses, left_out, axis=0)
        skill = fit_skill(AlignedDemonstrations(times=aligned.times, poses=given))
        scores.append(score(skill.predict(aligned.times), poses))
    return {
        **mean_scores(scores),
        "worst NLPD": max(one["NLPD"] for one in scores),
    }


def main(
    file: Annotated[Path, tyro.conf.Positional],
    unit: Unit = "m",
    quaternions: Order = "wxyz",
) -> None:
    """Learn from all recorded demonstrations but one and score that one, in turns.

    Args:
        file: An .npz file of this project, or an .npy array (demonstrations, samples,
            7) of positions and quaternions.
        unit: Unit of the positions of an .npy array.
        quaternions: Order of the quaternions of an .npy array.
    """
    try:
        recordings = load_recordings(file, unit, quaternions)
    except (ValueError, OSError) as error:
        sys.exit(f"recorded.py: {error}")
    measure_all({"recorded": lambda _: score_recordings(recordings, file)}, 1)


if __name__ == "__main__":
    tyro.cli(main)
