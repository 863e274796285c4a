"""Demonstrations as other programs see them: equal steps, quaternions, and actions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

_EQUAL: Final = 0.05  # Steps of time differ by less than this share of one.


@dataclass(frozen=True, kw_only=True, slots=True)
class Rows:
    """One demonstration, a row per sample."""

    rate: float
    """Samples per second [Hz]."""
    states: FloatArray
    """Position [m] and quaternion, the scalar last, (N, 7)."""
    actions: FloatArray
    """The state at the next sample, which is where the hand is to be; the last one is
    repeated, (N, 7)."""
    wrenches: FloatArray | None
    """Forces and moments of the environment on the hand, in the frame of the states and
    about the position of the hand [N, N m], (N, 6); or none."""
    signals: Mapping[str, FloatArray]
    """What else was recorded, (N, d) each."""
    pictures: Mapping[str, Sequence[bytes]] = field(default_factory=dict)
    """PNG files by the name of their camera, N each, all of one size."""
    task: str = "recorded motion"
    """What is done, in words."""


def demonstration_rows(labelled: LabelledDemonstrations) -> list[Rows]:
    """Return the rows of a set of demonstrations.

    Raises:
        ValueError: The steps of time are not equal, or not those of the others.
    """
    rows: list[Rows] = []
    for number, one in enumerate(labelled.demonstrations):
        steps = np.diff(one.times)
        rate = (len(steps)) / float(one.times[-1] - one.times[0])
        if np.abs(steps * rate - 1.0).max() > _EQUAL:
            raise ValueError(
                f"demonstration {number} is not sampled at equal steps; import it with "
                "--rate 100"
            )
        if rows and abs(rate / rows[0].rate - 1.0) > _EQUAL:
            raise ValueError(
                f"demonstration {number} has {rate:.4g} samples per second, and the "
                f"first {rows[0].rate:.4g}; import them with --rate 100"
            )
        states = states_of(one.poses)
        actions = np.vstack([states[1:], states[-1:]])
        signals = labelled.signals[number] if labelled.signals else {}
        rows.append(
            Rows(
                rate=rate,
                states=states,
                actions=actions,
                # As the environment observes them: of the opposite sign.
                wrenches=None if one.wrenches is None else -one.wrenches,
                signals=signals,
            )
        )
    return rows


def states_of(poses: FloatArray) -> FloatArray:
    """Return poses [m, rad], (N, 6), as positions and quaternions, scalar last."""
    rotations = Rotation.from_rotvec(poses[:, 3:].copy())
    states = np.hstack([poses[:, :3], rotations.as_quat()])
    # Successive quaternions are close, for actions are learned from states.
    flips = np.sum(states[1:, 3:] * states[:-1, 3:], axis=1) < 0.0
    states[1:, 3:] *= np.cumprod(np.where(flips, -1.0, 1.0))[:, None]
    return states
