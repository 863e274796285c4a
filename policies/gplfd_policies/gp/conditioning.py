"""Gaussian conditioning of six functions, one observation after another.

An observation sees all functions at one phase, y = f + e, with errors of the covariance
diag(σ²) + ρ ρᵀ; an infinite σ² leaves a function out. With S = L Lᵀ the covariance of y
given the earlier observations, and B = Cov(x, y) L⁻ᵀ,

    x ← x + B L⁻¹ (y − E y),  Cov x ← Cov x − B Bᵀ

for everything that is jointly Gaussian with y, as if all were observed at once
(``test_adapting_online_is_conditioning_on_all_at_once``).
"""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Bool, Float, Outputs, Pose

_DIAGONAL = np.diag_indices(6)

Places = tuple[np.ndarray, ...]
"""Arrays of what a covariance depends on at some phases, which are the first axis."""


class Innovation(NamedTuple):
    """What an observation adds to the earlier ones; L is 1 for what it leaves out."""

    observed: Bool[np.ndarray, "6"]
    root: Float[np.ndarray, "6 6"]
    inverse_root: Float[np.ndarray, "6 6"]
    whitened: Pose
    """L⁻¹ (y − E y)."""

    @classmethod
    def of(
        cls,
        covariance: Float[np.ndarray, "6 6"],
        missed: Pose,
        noise_variance: Pose,
        along: Pose | float,
    ) -> "Innovation":
        """Return it for the covariance of f, y − E y, σ² and ρ."""
        observed = np.isfinite(noise_variance)
        error = observed * along
        both = covariance * observed * observed[:, None]
        both += np.multiply.outer(error, error)
        both[_DIAGONAL] += np.where(observed, noise_variance, 1.0)
        root = np.linalg.cholesky(both)
        inverse_root, _ = scipy.linalg.lapack.dtrtri(root, lower=1)
        missed = np.where(observed, missed, 0.0)
        return cls(observed, root, inverse_root, inverse_root @ missed)


def conditioned(
    mean: Float[np.ndarray, " N"],
    covariance: Float[np.ndarray, "N N"],
    design: Float[np.ndarray, "6 N"],
    values: Pose,
    noise_variance: Pose,
    along: Pose | float = 0.0,
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "N N"]]:
    """Return mean and covariance of z given y = H z + e, with the design H."""
    gain = covariance @ design.T
    missed = values - design @ mean
    new = Innovation.of(design @ gain, missed, noise_variance, along)
    half = (gain * new.observed) @ new.inverse_root.T
    return mean + half @ new.whitened, covariance - half @ half.T


class ConditionedFunctions:
    """Six functions of prior mean zero, given observations; never changed.

    The root of S grows with them, and so does the last prediction, which is kept.
    """

    def __init__(
        self,
        covariance: Callable[[Places, Places], Float[np.ndarray, "A 6 B 6"]],
        nowhere: Places,
    ) -> None:
        """Start from the prior covariance between places, and the places of nothing."""
        self.covariance, self._places = covariance, nowhere
        self._root, self._white = np.empty((0, 0)), np.empty(0)
        self._observed = np.empty(0, dtype=bool)
        self._kept = nowhere, np.empty((0, 0))

    def explained(self, places: Places) -> tuple[Outputs, Float[np.ndarray, "P M 6"]]:
        """Return the mean at places, and the root of the covariance explained there."""
        if not np.array_equal(self._kept[0][0], places[0]):
            across = self.covariance(self._places, places)
            across = across.reshape(self._white.size, 6 * len(places[0]))
            across = across * self._observed[:, None]
            half = scipy.linalg.solve_triangular(self._root, across, lower=True)
            self._kept = places, half
        half = self._kept[1]
        mean = (self._white @ half).reshape(-1, 6)
        return mean, half.reshape(-1, *mean.shape)

    def given(
        self, place: Places, values: Pose, noise_variance: Pose, along: Pose
    ) -> tuple["ConditionedFunctions", Innovation]:
        """Return them given another observation, in O(P² + M P) for P earlier ones."""
        between, size, later = self.covariance, self._white.size, copy.copy(self)
        earlier = between(self._places, place).reshape(-1, 6) * self._observed[:, None]
        cross = scipy.linalg.solve_triangular(self._root, earlier, lower=True)
        remaining = between(place, place).reshape(6, 6) - cross.T @ cross
        values = values - cross.T @ self._white
        new = Innovation.of(remaining, values, noise_variance, along)
        cross *= new.observed
        grid, half = self._kept
        across = between(place, grid) * new.observed[:, None, None]
        rows = new.inverse_root @ (across.reshape(6, half.shape[1]) - cross.T @ half)
        later._kept = grid, np.concatenate([half, rows])
        later._root = np.block([[self._root, np.zeros((size, 6))], [cross.T, new.root]])
        later._white = np.append(self._white, new.whitened)
        later._observed = np.append(self._observed, new.observed)
        both = zip(self._places, place, strict=True)
        later._places = tuple(np.concatenate(pair) for pair in both)
        return later, new
