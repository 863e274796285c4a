"""Demonstrations drawn from known distributions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from experiments.teacher.random_motion import minimum_jerk, smooth_functions
from gplfd_env.task import DEMONSTRATED_ANGLE, handle_pose_on_arc
from policies.aligned import AlignedDemonstrations

Array = NDArray[np.float64]
Deviations = Literal["independent", "smooth"]

_CORRELATION = 0.25
"""Phase over which smooth deviations change."""
_WHITE = 0.01
"""Share of a smooth deviation's variance that is white."""


@dataclass(frozen=True, kw_only=True, slots=True)
class KnownProcess:
    """Six smooth outputs with a standard deviation that varies up to sixteenfold."""

    times: Array
    """Phases, (M,)."""
    mean: Array
    """Mean, (M, 6)."""
    std: Array
    """Standard deviation of a demonstration, (M, 6)."""

    @classmethod
    def on_grid(cls, samples: int) -> KnownProcess:
        """The process at equally spaced phases."""
        times = np.linspace(0.0, 1.0, samples)
        output = np.arange(6)
        clock = times[:, None]
        mean = np.sin((2.0 + output) * clock + output) + 0.5 * clock * np.cos(output)
        wave = np.sin((3.0 + 0.5 * output) * clock + 2.0 * output)
        return cls(times=times, mean=mean, std=0.02 * np.exp(math.log(4.0) * wave))

    def draw(self, count: int, kind: Deviations, rng: np.random.Generator) -> Array:
        """Draw demonstrations, (count, M, 6).

        Args:
            count: How many.
            kind: "independent" from sample to sample, as heteroscedastic regression
                assumes, or "smooth", as people move.
            rng: Source of randomness.
        """
        white = rng.standard_normal((count, *self.mean.shape))
        if kind == "independent":
            return self.mean + self.std * white
        smooth = smooth_functions(self.times, _CORRELATION, 6 * count, rng)
        smooth = smooth.reshape(len(self.times), count, 6).swapaxes(0, 1)
        mixed = math.sqrt(1.0 - _WHITE) * smooth + math.sqrt(_WHITE) * white
        drawn: Array = self.mean + self.std * mixed
        return drawn

    def demonstrations(
        self, count: int, kind: Deviations, rng: np.random.Generator
    ) -> AlignedDemonstrations:
        """Draw demonstrations as a policy learns from."""
        return AlignedDemonstrations(
            times=self.times, poses=self.draw(count, kind, rng)
        )


def door_opening(
    radius: float, times: Array, rng: np.random.Generator, wobble_std: float = 1.5e-3
) -> Array:
    """Open a door in minimum-jerk time while the hand wobbles smoothly.

    Args:
        radius: Distance from hinge to handle [m].
        times: Phases from 0 to 1, (M,).
        rng: Source of randomness.
        wobble_std: Standard deviation of the wobble [m; 4 times as much in rad],
            which is zero at the start.

    Returns:
        Poses, (M, 6) [m, rad].
    """
    arc = handle_pose_on_arc(radius, DEMONSTRATED_ANGLE * minimum_jerk(times))
    wobble = (
        smooth_functions(times, 0.2, 6, rng) * np.minimum(1.0, 10.0 * times)[:, None]
    )
    opening: Array = arc + wobble_std * np.repeat([1.0, 4.0], 3) * wobble
    return opening
