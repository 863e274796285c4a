"""Writes demonstrations and episodes in formats of other programs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.npz import (
    LabelledDemonstrations,
    load_demonstrations,
)

_EQUAL: Final = 0.05  # Largest relative difference of time steps.


@dataclass(frozen=True, kw_only=True, slots=True)
class Rows:
    """One demonstration, a row per sample."""

    rate: float
    """Samples per second [Hz]."""
    states: FloatArray
    """Position [m] and quaternion, the scalar last, (N, 7)."""
    actions: FloatArray
    """The state to be reached at the next sample, (N, 7)."""
    wrenches: FloatArray | None
    """Forces and moments of the environment on the hand, in the frame of the states and
    about the position of the hand [N, N m], (N, 6); or none."""
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    """Other recorded signals, (N, d) each."""
    pictures: Mapping[str, Sequence[bytes]] = field(default_factory=dict)
    """PNG files by the name of their camera, N each, all of the same size."""
    task: str = "recorded motion"
    """Description of the task."""


def demonstration_rows(labelled: LabelledDemonstrations) -> list[Rows]:
    """Return the rows of demonstrations; raise ValueError unless steps are equal."""
    rows: list[Rows] = []
    for number, demonstration in enumerate(labelled.demonstrations):
        times, wrenches = demonstration.times, demonstration.wrenches
        steps = np.diff(times)
        rate = len(steps) / float(times[-1] - times[0])
        usual = rows[0].rate if rows else rate
        if np.abs(steps * usual - 1.0).max() > _EQUAL:
            raise ValueError(
                f"demonstration {number} is not sampled at equal steps of "
                f"{1.0 / usual:.4g} s; import all with --rate 100"
            )
        states = states_of(demonstration.poses)
        rows.append(
            Rows(
                rate=rate,
                states=states,
                actions=np.vstack([states[1:], states[-1:]]),
                # As the environment observes them: of the opposite sign.
                wrenches=None if wrenches is None else -wrenches,
                signals=labelled.signals[number] if labelled.signals else {},
            )
        )
    return rows


def states_of(poses: FloatArray) -> FloatArray:
    """Return poses [m, rad], (N, 6), as positions and quaternions, scalar last.

    Successive quaternions have consistent signs, as actions are learned from states.
    """
    rotations = Rotation.from_rotvec(poses[:, 3:])
    states = np.hstack([poses[:, :3], rotations.as_quat()])
    flips = np.sum(states[1:, 3:] * states[:-1, 3:], axis=1) < 0.0
    states[1:, 3:] *= np.cumprod(np.where(flips, -1.0, 1.0))[:, None]
    return states


def export_demonstrations(
    source: Path,
    target: Path,
    *,
    rate: int | None = None,
    cameras: Sequence[str] = (),
    size: tuple[int, int] = (320, 240),
) -> int:
    """Write demonstrations or episodes for LeRobot, and return how many.

    Episodes are written with a number of rows per second (100, or 10 with pictures) and
    the pictures of some cameras, whose size is width and height [px].

    Raises:
        ValueError: The target exists, or the source cannot be exported.
        OSError: A file cannot be read or written, or this machine cannot render.
        ModuleNotFoundError: The library of the format is not installed.
    """
    if target.exists():
        raise ValueError(f"--out {target} exists; give another")
    from gplfd_experiments.data.writers import lerobot

    if (source / "data/metadata.json").is_file():
        from gplfd_experiments.data.minari import open_dataset
        from gplfd_experiments.data.writers.episodes import episode_rows

        rate = rate or (10 if cameras else 100)
        rows = episode_rows(open_dataset(source), rate, cameras, size)
    elif cameras or rate is not None:
        raise ValueError(
            f"{source} holds motions alone; --pictures and --rate are for episodes of "
            "`gplfd demos record`"
        )
    else:
        rows = demonstration_rows(load_demonstrations(source))
    lerobot.write(target, rows)
    return len(rows)
