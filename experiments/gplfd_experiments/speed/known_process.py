"""Demonstrations drawn from a known distribution, and scores of its predictions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, Self

import numpy as np

from gplfd_experiments.data.teacher.random_motion import smooth_functions
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.trajectory import GaussianTrajectory, white_covariance

Deviations = Literal["independent", "smooth"]
"""Deviations of a demonstration from the mean: independent from sample to sample, as
heteroscedastic regression assumes, or smooth, as in human motion."""

_CORRELATION = 0.25
"""Phase over which smooth deviations change."""
_WHITE = 0.01
"""Share of a smooth deviation's variance that is white."""


@dataclass(frozen=True, kw_only=True, slots=True)
class KnownProcess:
    """Six smooth outputs with a standard deviation that varies up to sixteenfold."""

    truth: GaussianTrajectory
    """Mean and standard deviation of a demonstration at M phases."""

    @classmethod
    def on_grid(cls, samples: int) -> Self:
        """Return the process at equally spaced phases."""
        times = np.linspace(0.0, 1.0, samples)
        output = np.arange(6)
        clock = times[:, None]
        mean = np.sin((2.0 + output) * clock + output) + 0.5 * clock * np.cos(output)
        wave = np.sin((3.0 + 0.5 * output) * clock + 2.0 * output)
        std = 0.02 * np.exp(math.log(4.0) * wave)
        truth = GaussianTrajectory.from_moments(
            times, mean, std, partial(white_covariance, std**2)
        )
        return cls(truth=truth)

    def draw(
        self, count: int, kind: Deviations, rng: np.random.Generator
    ) -> FloatArray:
        """Draw demonstrations, (``count``, M, 6)."""
        mean, std = self.truth.mean, self.truth.std
        white = rng.standard_normal((count, *mean.shape))
        if kind == "independent":
            return mean + std * white
        smooth = smooth_functions(self.truth.times, _CORRELATION, 6 * count, rng)
        smooth = smooth.reshape(len(mean), count, 6).swapaxes(0, 1)
        mixed = math.sqrt(1.0 - _WHITE) * smooth + math.sqrt(_WHITE) * white
        return mean + std * mixed

    def demonstrations(
        self, count: int, kind: Deviations, rng: np.random.Generator
    ) -> AlignedDemonstrations:
        """Draw demonstrations in the format for learning."""
        poses = self.draw(count, kind, rng)
        return AlignedDemonstrations(times=self.truth.times, poses=poses)


def score(predicted: GaussianTrajectory, held_out: FloatArray) -> dict[str, float]:
    """Score a prediction on other poses (..., M, 6), by column of a table.

    Negative log predictive density per number; the share within mean ± 1.96 std,
    0.95 if the standard deviation is correct; and the share in the stated 95 % interval
    of the prediction, which is wider with few demonstrations.
    """
    return {
        "NLPD": predicted.nlpd(held_out),
        "within 1.96 std": predicted.coverage(held_out, normal=True),
        "in stated 95 %": predicted.coverage(held_out),
    }


def mean_scores(scores: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the mean of every column."""
    return {name: float(np.mean([one[name] for one in scores])) for name in scores[0]}
