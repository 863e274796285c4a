"""Completion that is corrected where demonstrations turn in the same way.

How much of its path a hand has covered tells how far it is in the task, if the parts
of the task are equally large shares of every path. They are not where a demonstration
came from farther away, did a part twice, or made one stroke longer than the others. The
direction in which the hand moves tells these apart: it depends neither on where a path
lies nor on how large its parts are.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from gplfd_policies.demonstrations.dynamic_time_warping import dynamic_time_warping

_STEPS: Final = 100
"""Of completion, at which directions are compared."""
_HALF_CHORD: Final = 4
"""Directions are those of chords over twice as many steps: above a sensor's noise."""
_SLOWEST: Final = 0.1
"""A chord shorter than this share of the usual one, at a reversal, tells less."""
_TETHER: Final = 0.5
"""What a difference of completion by one costs; opposite directions cost two."""
_BLUR: Final = 2.0
"""Standard deviation of the smoother of a correction, in steps: matches are stairs."""


def corrected_completions(
    completions: Sequence[Float[np.ndarray, " _"]],
    poses: Sequence[Float[np.ndarray, "_ 6"]],
    rotation_weight: float,
) -> list[Float[np.ndarray, " _"]]:
    """Return completions at which demonstrations move in the same directions.

    Each demonstration's directions at equal steps of completion are matched with their
    mean over the demonstrations, by dynamic time warping with the cost
    ``|u_a - u_b|² + (ζ_a - ζ_b)² / 4``; where the direction does not change, on a
    straight line, completion alone decides. What it came to is smoothed.

    Args:
        completions: Strictly increasing from 0 to 1, (N,) each.
        poses: Of the same samples [m, rad], (N, 6) each.
        rotation_weight: ω₁ of Eq. (17), which weighs turning against moving.

    Returns:
        Completions from 0 to 1, never falling, (N,) each.
    """
    steps = np.linspace(0.0, 1.0, _STEPS)
    scale = np.repeat(np.sqrt([1.0 - rotation_weight, rotation_weight]), 3)
    directions = [
        _directions(
            scale * np.column_stack([np.interp(steps, index, one) for one in path.T])
        )
        for index, path in zip(completions, poses, strict=True)
    ]
    common = np.mean(directions, axis=0)
    return [
        np.interp(index, steps, _matched(own, common, steps))
        for index, own in zip(completions, directions, strict=True)
    ]


def _directions(path: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 6"]:
    """Return unit vectors along a path, shorter ones where it turns back."""
    padded = np.pad(path, ((_HALF_CHORD, _HALF_CHORD), (0, 0)), mode="edge")
    chords = padded[2 * _HALF_CHORD :] - padded[: -2 * _HALF_CHORD]
    lengths = np.linalg.norm(chords, axis=1)
    least = max(_SLOWEST * float(np.median(lengths)), np.finfo(np.float64).tiny)
    directions: np.ndarray = chords / np.maximum(lengths, least)[:, None]
    return directions


def _matched(
    own: Float[np.ndarray, "M 6"],
    common: Float[np.ndarray, "M 6"],
    steps: Float[np.ndarray, " M"],
) -> Float[np.ndarray, " M"]:
    """Return where the common directions are those of a demonstration's steps."""

    def cost_row(row: int) -> Float[np.ndarray, " M"]:
        apart = np.sum((common - own[row]) ** 2, axis=1)
        return np.asarray(apart + (_TETHER * (steps - steps[row])) ** 2)

    path = dynamic_time_warping(cost_row, len(steps))
    matches = np.bincount(path.rows)
    stairs = np.bincount(path.rows, weights=steps[path.columns]) / matches
    correction = gaussian_filter1d(stairs - steps, _BLUR, mode="nearest")
    # Ends stay matched with ends.
    correction -= (1.0 - steps) * correction[0] + steps * correction[-1]
    rising = np.maximum.accumulate(steps + correction)
    return np.asarray(np.clip(rising, 0.0, 1.0))
